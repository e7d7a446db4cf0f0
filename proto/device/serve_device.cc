#include "proto/device/serve_device.h"

#include <grp.h>
#include <pwd.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "filter/opencl/open_device.h"
#include "proto/device/call_messages.h"
#include "proto/device/fit_messages.h"
#include "proto/device/layer_messages.h"
#include "proto/device/socket_stream.h"
#include "proto/rpc/byte_stream.h"
#include "proto/threads/event.h"

namespace lumifold::device {
namespace {

constexpr int kFailedCode = 1;
constexpr int kControl = STDIN_FILENO;
constexpr size_t kMostText = 2048;

void Say(char what, const std::string& text) {
  const std::string message = absl::StrCat(std::string(1, what), text.substr(0, kMostText));
  (void)send(kControl, message.data(), message.size(), MSG_NOSIGNAL);
}

/// Becomes the user, of the groups that may open devices; keeps the rest of its rights from programs that a
/// driver starts.
absl::Status BecomeUser(const std::string& name) {
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  if (name.empty() || geteuid() != 0) return absl::OkStatus();
  const passwd* const user = getpwnam(name.c_str());  // one thread runs
  if (user == nullptr) return absl::NotFoundError(absl::StrCat("no user '", name, "'"));
  const uid_t id = user->pw_uid;
  const gid_t own_group = user->pw_gid;
  setenv("HOME", user->pw_dir, /*overwrite=*/1);  // where drivers keep compiled kernels
  std::vector<gid_t> groups;
  for (const char* group_name : {"render", "video"}) {
    if (const group* const found = getgrnam(group_name); found != nullptr) groups.push_back(found->gr_gid);
  }
  if (setgroups(groups.size(), groups.data()) != 0 || setresgid(own_group, own_group, own_group) != 0 ||
      setresuid(id, id, id) != 0)
    return absl::ErrnoToStatus(errno, absl::StrCat("becoming user ", name));
  return absl::OkStatus();
}

/// Serves connections, a call at a time.
class Service {
 public:
  explicit Service(absl::Duration time_limit) : time_limit_(time_limit) {}

  void SetDevice(std::shared_ptr<filter::FilterDevice> device) { device_ = std::move(device); }

  /// Blocks until the other end is closed.
  void Serve(rpc::FileHandle connection) {
    {
      absl::MutexLock lock(&mutex_);
      connections_.insert(connection.get());
    }
    SocketStream stream(connection.get());
    while (Answer(&stream)) {
    }
    absl::MutexLock lock(&mutex_);
    connections_.erase(connection.get());
    connection = {};  // its number may be another's from now on
  }

  /// Says why and ends the process. Callers are told first: a driver may keep the process from ending.
  [[noreturn]] void Fail(const std::string& reason) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    Say(kFailed, reason);
    for (const int connection : connections_) shutdown(connection, SHUT_RDWR);
    _exit(kFailedCode);
  }

 private:
  /// Work of the device, within the limit of time.
  template <typename Work>
  auto Watched(const Work& work) {
    absl::MutexLock lock(&device_mutex_);
    threads::Event has_ended;
    std::thread watch([&] {
      if (!has_ended.WaitFor(time_limit_)) Fail("it does not answer");
    });
    auto result = work();
    has_ended.Notify();
    watch.join();
    return result;
  }

  /// Answers the next message. False: it was the last.
  bool Answer(SocketStream* stream) {
    const std::optional<Operation> operation = ReceiveOperation(stream);
    if (!operation.has_value()) return false;
    if (*operation == Operation::kFit) {
      const std::optional<ReceivedFit> fit = ReceiveFit(stream);
      return fit.has_value() && Send(Watched([&] { return device_->Fit(fit->View()); }), SendResult, stream);
    }
    if (*operation == Operation::kLayer) {
      const std::optional<ReceivedLayer> layer = ReceiveLayer(stream);
      return layer.has_value() &&
             Send(Watched([&] { return device_->FilterLayer(layer->View()); }), SendResult, stream);
    }
    const std::optional<ReceivedCall> call = ReceiveCall(stream);
    return call.has_value() &&
           Send(Watched([&] { return device_->Filter(call->View()); }), SendResult, stream);
  }

  /// No result: the device leaves the call; one that fails ends the process.
  template <typename Result>
  static bool Send(const std::optional<Result>& result, bool (*send)(const Result&, SocketStream*),
                   SocketStream* stream) {
    return SendHasResult(result.has_value(), stream) && (!result.has_value() || send(*result, stream));
  }

  const absl::Duration time_limit_;
  std::shared_ptr<filter::FilterDevice> device_;
  absl::Mutex device_mutex_;
  absl::Mutex mutex_;
  std::set<int> connections_ ABSL_GUARDED_BY(mutex_);
};

absl::StatusOr<filter::OpenedDevice> Open(const filter::DeviceChoice& choice, const std::string& user,
                                          Service* service) {
  if (absl::Status status = BecomeUser(user); !status.ok()) return status;
  return filter::OpenFilterDevice(choice, [service](bool has_failed, const std::string& reason) {
    if (has_failed) service->Fail(reason);
    Say(kLeaves, reason);
  });
}

}  // namespace

int RunDeviceProcess(const std::vector<std::string>& arguments) {
  double seconds = 0;
  if (arguments.size() != 4 || !absl::SimpleAtod(arguments[2], &seconds)) return kFailedCode;
  Service service(absl::Seconds(seconds));
  const absl::StatusOr<filter::OpenedDevice> device =
      Open({.word = arguments[0], .allows_other_bits = arguments[1] == "1"}, arguments[3], &service);
  if (!device.ok()) {
    Say(kFailed, std::string(device.status().message()));
    return kFailedCode;
  }
  if (device->device == nullptr) {
    Say(kNone, "");
    return 0;
  }
  service.SetDevice(device->device);
  Say(kReady, absl::StrCat(device->name, "\n", device->device->OtherBits()));
  while (true) {
    rpc::FileHandle connection = ReceiveDescriptor(kControl);
    if (connection.get() < 0) _exit(0);  // the driver's threads and ours may be at work
    std::thread([&service, own = std::move(connection)]() mutable {
      service.Serve(std::move(own));
    }).detach();
  }
}

}  // namespace lumifold::device
