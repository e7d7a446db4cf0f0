#include "proto/device/device_process.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/device/call_messages.h"
#include "proto/device/fit_messages.h"
#include "proto/device/layer_messages.h"
#include "proto/device/serve_device.h"
#include "proto/device/socket_stream.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::device {
namespace {

constexpr absl::Duration kTimeLimit = absl::Seconds(150);
/// Calls of others that one may wait for.
constexpr int kQueue = 16;
/// From the end of a connection to the words about it.
constexpr absl::Duration kLastWords = absl::Seconds(1);
/// For the process to end; a driver may keep it.
constexpr absl::Duration kEnd = absl::Seconds(1);
constexpr size_t kMessageBytes = 4096;

struct Ends {
  rpc::FileHandle here;
  rpc::FileHandle there;
};
absl::StatusOr<Ends> MakeSockets(int type) {
  std::array<int, 2> ends = {-1, -1};
  if (socketpair(AF_UNIX, type | SOCK_CLOEXEC, 0, ends.data()) != 0)
    return absl::UnavailableError(absl::StrCat("a socket: ", std::strerror(errno)));
  return Ends{rpc::FileHandle(ends[0]), rpc::FileHandle(ends[1])};
}

/// The next message of the process, whose first character says what it is; empty: it has ended; nullopt: it
/// has said nothing for `patience`.
std::optional<std::string> NextMessage(int control, absl::Duration patience) {
  pollfd file = {control, POLLIN, 0};
  const auto milliseconds = std::min<int64_t>(absl::ToInt64Milliseconds(patience), 1 << 30);
  int ready = 0;
  do ready = poll(&file, 1, static_cast<int>(milliseconds));
  while (ready < 0 && errno == EINTR);
  if (ready == 0) return std::nullopt;
  std::string text(kMessageBytes, '\0');
  const ssize_t count = recv(control, text.data(), text.size(), MSG_DONTWAIT);
  text.resize(static_cast<size_t>(std::max<ssize_t>(count, 0)));
  return text;
}

class DeviceLink final : public filter::FilterDevice {
 public:
  DeviceLink(rpc::FileHandle connection, std::string other_bits, absl::Duration time_limit,
             std::function<void()> on_trouble)
      : connection_(std::move(connection)),
        other_bits_(std::move(other_bits)),
        stream_(connection_.get(), kQueue * time_limit),
        on_trouble_(std::move(on_trouble)) {}

  std::string OtherBits() const override { return other_bits_; }
  std::optional<filter::ManifoldResult> Filter(const filter::ManifoldCall& call) override {
    absl::MutexLock lock(&mutex_);
    return Ask<filter::ManifoldResult>(call, [&] { return SendCall(call, &stream_); });
  }
  std::optional<filter::FitResult> Fit(const filter::FitCall& call) override {
    absl::MutexLock lock(&mutex_);
    return Ask<filter::FitResult>(call, [&] { return SendFit(call, &stream_); });
  }
  std::optional<filter::LayerResult> FilterLayer(const filter::LayerCall& call) override {
    absl::MutexLock lock(&mutex_);
    return Ask<filter::LayerResult>(call, [&] { return SendLayer(call, &stream_); });
  }

 private:
  template <typename Result, typename Call, typename Send>
  std::optional<Result> Ask(const Call& call, const Send& send) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (has_failed_ || !CanSend(call)) return std::nullopt;
    std::optional<Result> result;
    const std::optional<bool> has_result = send() ? ReceiveHasResult(&stream_) : std::nullopt;
    if (has_result.value_or(false)) result = ReceiveResult(call, &stream_);
    if (result.has_value()) return result;
    has_failed_ = has_result.value_or(true);
    if (has_failed_ || !std::exchange(has_left_, true)) on_trouble_();
    return std::nullopt;
  }

  const rpc::FileHandle connection_;
  const std::string other_bits_;
  absl::Mutex mutex_;
  SocketStream stream_ ABSL_GUARDED_BY(mutex_);
  const std::function<void()> on_trouble_;
  bool has_failed_ ABSL_GUARDED_BY(mutex_) = false;
  bool has_left_ ABSL_GUARDED_BY(mutex_) = false;  // a call to the processor
};

/// A link that keeps its process.
class OwnDevice final : public filter::FilterDevice {
 public:
  explicit OwnDevice(std::unique_ptr<DeviceProcess> process)
      : process_(std::move(process)), link_(process_->Link()) {}

  std::string OtherBits() const override { return link_->OtherBits(); }
  std::optional<filter::ManifoldResult> Filter(const filter::ManifoldCall& call) override {
    return link_->Filter(call);
  }
  std::optional<filter::FitResult> Fit(const filter::FitCall& call) override { return link_->Fit(call); }
  std::optional<filter::LayerResult> FilterLayer(const filter::LayerCall& call) override {
    return link_->FilterLayer(call);
  }

 private:
  const std::unique_ptr<DeviceProcess> process_;
  const std::shared_ptr<filter::FilterDevice> link_;
};

}  // namespace

absl::Duration DeviceProcessOptions::DefaultTimeLimit() {
  const char* const text = std::getenv("LUMIFOLD_DEVICE_SECONDS");
  double seconds = 0;
  if (text == nullptr || !absl::SimpleAtod(text, &seconds) || !(seconds > 0)) return kTimeLimit;
  return absl::Seconds(seconds);
}

absl::StatusOr<std::unique_ptr<DeviceProcess>> DeviceProcess::Start(DeviceProcessOptions options) {
  const filter::DeviceChoice& choice = options.choice;
  if (absl::Status status = filter::CheckDeviceChoice(choice.word); !status.ok()) return status;
  const bool is_auto = choice.word == "auto";
  if (choice.word == "cpu" || (is_auto && !filter::MayHaveGpu())) return nullptr;
  absl::StatusOr<Ends> control = MakeSockets(SOCK_SEQPACKET);
  if (!control.ok()) return control.status();
  absl::StatusOr<std::unique_ptr<subprocess::Child>> child = subprocess::Child::Start(
      {.words = {options.program, kDeviceCommand, choice.word, choice.allows_other_bits ? "1" : "0",
                 absl::StrCat(absl::ToDoubleSeconds(options.time_limit)), options.user},
       .in = subprocess::Stream::kFile,
       .in_file = control->there.get(),
       .out = subprocess::Stream::kStandardError,
       .own_group = true});
  if (!child.ok()) return child.status();
  control->there = {};
  std::unique_ptr<DeviceProcess> process(
      new DeviceProcess(std::move(options), std::move(control->here), *std::move(child)));
  absl::Status opened = process->AwaitOpen();
  if (!opened.ok() && !is_auto) return opened;
  if (!opened.ok()) process->options_.warn(std::string(opened.message()));
  if (process->name_.empty()) return nullptr;
  return process;
}

absl::Status DeviceProcess::AwaitOpen() {
  absl::MutexLock lock(&mutex_);
  const std::optional<std::string> message = NextMessage(control_.get(), options_.time_limit);
  if (!message.has_value()) return absl::DeadlineExceededError("the driver of the device does not answer");
  if (message->empty()) return absl::FailedPreconditionError("the driver of the device has crashed");
  if (message->front() == kFailed) return absl::FailedPreconditionError(message->substr(1));
  if (message->front() != kReady) return absl::OkStatus();
  const size_t end = message->find('\n');
  name_ = message->substr(1, end - 1);
  other_bits_ = message->substr(std::min(end, message->size() - 1) + 1);
  return absl::OkStatus();
}

DeviceProcess::~DeviceProcess() {
  {
    absl::MutexLock lock(&mutex_);
    control_ = {};  // it ends by that; a sandbox may not let it be killed
  }
  child_->Kill();
  // A driver that the kernel waits for keeps its process, whose end nobody has to wait for.
  if (child_->Wait(rpc::MonotonicNow() + kEnd).ok()) return;
  [[maybe_unused]] const subprocess::Child* left = child_.release();
}

rpc::FileHandle DeviceProcess::Connect() {
  absl::MutexLock lock(&mutex_);
  absl::StatusOr<Ends> ends = MakeSockets(SOCK_STREAM);
  if (has_failed_ || !ends.ok()) return {};
  if (SendDescriptor(control_.get(), ends->there.get())) return std::move(ends->here);
  ReadMessages(kLastWords);
  if (!has_failed_) Fail("");
  return {};
}

std::shared_ptr<filter::FilterDevice> DeviceProcess::Link() {
  return MakeDeviceLink(Connect(), other_bits_, options_.time_limit, [this] { CheckTrouble(kLastWords); });
}

void DeviceProcess::CheckTrouble(absl::Duration patience) {
  absl::MutexLock lock(&mutex_);
  ReadMessages(patience);
}

void DeviceProcess::ReadMessages(absl::Duration patience) {
  while (!has_failed_) {
    const std::optional<std::string> message = NextMessage(control_.get(), patience);
    if (!message.has_value()) return;
    if (message->empty() || message->front() != kLeaves) return Fail(*message);
    options_.warn(
        absl::StrCat(name_, " leaves what needs more memory to this processor: ", message->substr(1)));
    patience = absl::ZeroDuration();
  }
}

void DeviceProcess::Fail(const std::string& message) {
  has_failed_ = true;
  const std::string reason = message.empty() ? "its driver has crashed" : message.substr(1);
  options_.warn(absl::StrCat(name_, " fails, this processor filters instead: ", reason));
  child_->Kill();
}

std::shared_ptr<filter::FilterDevice> MakeDeviceLink(rpc::FileHandle connection, std::string other_bits,
                                                     absl::Duration time_limit,
                                                     std::function<void()> on_trouble) {
  return std::make_shared<DeviceLink>(std::move(connection), std::move(other_bits), time_limit,
                                      std::move(on_trouble));
}

absl::StatusOr<filter::OpenedDevice> OpenDevice(DeviceProcessOptions options) {
  absl::StatusOr<std::unique_ptr<DeviceProcess>> process = DeviceProcess::Start(std::move(options));
  if (!process.ok()) return process.status();
  if (*process == nullptr) return filter::OpenedDevice{};
  const std::string name = (*process)->name();
  return filter::OpenedDevice{name, std::make_shared<OwnDevice>(*std::move(process))};
}

}  // namespace lumifold::device
