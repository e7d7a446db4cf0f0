#include "proto/subprocess/child.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <string_view>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::subprocess {
namespace {

constexpr size_t kPieceBytes = 65536;
/// poll takes 32 bits of milliseconds.
constexpr absl::Duration kLongestPoll = absl::Minutes(1);
/// How often it is asked whether a child has ended, where there is a deadline.
constexpr absl::Duration kEndInterval = absl::Milliseconds(20);

int Milliseconds(absl::Duration duration) { return static_cast<int>(absl::ToInt64Milliseconds(duration)); }

/// A machine that has no descriptor, process or memory left may have one later.
absl::Status SystemError(int error) {
  const bool may_pass = error == EMFILE || error == ENFILE || error == EAGAIN || error == ENOMEM;
  return may_pass ? absl::UnavailableError(std::strerror(error)) : absl::InternalError(std::strerror(error));
}

bool IsChanged(std::string_view variable, const std::vector<std::string>& changes) {
  const std::string_view name = variable.substr(0, variable.find('='));
  return std::any_of(changes.begin(), changes.end(), [name](std::string_view change) {
    const std::string_view changed = change.substr(0, change.find('='));
    const bool is_prefix = change.ends_with('*') && changed == change;  // a value may end with it, too
    return is_prefix ? name.starts_with(change.substr(0, change.size() - 1)) : name == changed;
  });
}

std::vector<std::string> ChangedEnvironment(const std::vector<std::string>& changes) {
  std::vector<std::string> variables;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    if (!IsChanged(*variable, changes)) variables.emplace_back(*variable);
  }
  std::copy_if(changes.begin(), changes.end(), std::back_inserter(variables),
               [](const std::string& change) { return absl::StrContains(change, '='); });
  return variables;
}

/// Pointers to the texts, and a null pointer. posix_spawn takes char*, but does not write to it.
std::vector<char*> PointersTo(const std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  pointers.reserve(texts.size() + 1);
  for (const std::string& text : texts) pointers.push_back(const_cast<char*>(text.c_str()));
  pointers.push_back(nullptr);
  return pointers;
}

struct Pipe {
  rpc::FileHandle read;
  rpc::FileHandle write;
};

/// No descriptors for streams that are no pipe.
absl::StatusOr<Pipe> MakePipe(Stream stream) {
  if (stream != Stream::kPipe) return Pipe();
  std::array<int, 2> ends = {-1, -1};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) return SystemError(errno);
  return Pipe{rpc::FileHandle(ends[0]), rpc::FileHandle(ends[1])};
}

/// How posix_spawn is to prepare the child.
class Preparation {
 public:
  explicit Preparation(bool own_group) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawnattr_init(&attributes_);
    // This process may block signals that it waits for; the child must not inherit that.
    sigset_t none;
    sigemptyset(&none);
    posix_spawnattr_setsigmask(&attributes_, &none);
    const int group = own_group ? POSIX_SPAWN_SETPGROUP : 0;
    posix_spawnattr_setflags(&attributes_, static_cast<int16_t>(POSIX_SPAWN_SETSIGMASK | group));
  }
  Preparation(const Preparation&) = delete;
  Preparation& operator=(const Preparation&) = delete;
  ~Preparation() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }

  /// Makes `target` of the child what `stream` says.
  void Set(int target, Stream stream, const Pipe& pipe) {
    if (stream == Stream::kNothing)
      posix_spawn_file_actions_addopen(&actions_, target, "/dev/null",
                                       target == STDIN_FILENO ? O_RDONLY : O_WRONLY, 0);
    if (stream == Stream::kPipe) posix_spawn_file_actions_adddup2(&actions_, pipe.write.get(), target);
    if (stream == Stream::kStandardError) posix_spawn_file_actions_adddup2(&actions_, STDERR_FILENO, target);
  }

  void SetFile(int target, int file) { posix_spawn_file_actions_adddup2(&actions_, file, target); }

  absl::StatusOr<pid_t> Spawn(const std::vector<std::string>& words,
                              const std::vector<std::string>& environment) const {
    pid_t pid = -1;
    const int error = posix_spawnp(&pid, words.front().c_str(), &actions_, &attributes_,
                                   PointersTo(words).data(), PointersTo(environment).data());
    if (error != 0) return SystemError(error);
    return pid;
  }

 private:
  posix_spawn_file_actions_t actions_ = {};
  posix_spawnattr_t attributes_ = {};
};

/// Reads what has arrived; false once the other end is closed.
bool ReadSome(int file, std::string* text) {
  std::array<char, kPieceBytes> piece;
  const int64_t count = ReadNext(file, piece.data(), piece.size());
  if (count <= 0) return false;
  text->append(piece.data(), static_cast<size_t>(count));
  return true;
}

}  // namespace

std::string ExitStatus::Text() const {
  return signal != 0 ? absl::StrCat("ended by signal ", signal) : absl::StrCat("ended with code ", code);
}

absl::StatusOr<std::unique_ptr<Child>> Child::Start(const ChildOptions& options) {
  absl::StatusOr<Pipe> out = MakePipe(options.out);
  if (!out.ok()) return out.status();
  absl::StatusOr<Pipe> err = MakePipe(options.err);
  if (!err.ok()) return err.status();
  Preparation preparation(options.own_group);
  if (options.in == Stream::kFile)
    preparation.SetFile(STDIN_FILENO, options.in_file);
  else
    preparation.Set(STDIN_FILENO, options.in, {});
  preparation.Set(STDOUT_FILENO, options.out, *out);
  preparation.Set(STDERR_FILENO, options.err, *err);
  const absl::StatusOr<pid_t> pid = preparation.Spawn(options.words, ChangedEnvironment(options.environment));
  if (!pid.ok()) return pid.status();
  return std::unique_ptr<Child>(
      new Child(*pid, options.own_group, std::move(out->read), std::move(err->read)));
}

Child::~Child() {
  {
    absl::MutexLock lock(&mutex_);
    if (is_reaped_) return;
  }
  Kill();
  (void)Wait();
}

bool Child::ReadOutput(absl::Time deadline, size_t max_bytes, Output* output,
                       absl::FunctionRef<void(Output*)> on_news) {
  // poll ignores what is no descriptor.
  std::array<pollfd, 2> files = {{{out_.get(), POLLIN, 0}, {err_.get(), POLLIN, 0}}};
  const std::array<std::string*, 2> texts = {&output->out, &output->err};
  while (files[0].fd >= 0 || files[1].fd >= 0) {
    const absl::Duration left = deadline - rpc::MonotonicNow();
    if (left <= absl::ZeroDuration() || output->out.size() + output->err.size() > max_bytes) return false;
    poll(files.data(), files.size(), Milliseconds(std::min(left, kLongestPoll)) + 1);
    for (size_t i = 0; i < files.size(); ++i) {
      if (files[i].fd >= 0 && files[i].revents != 0 && !ReadSome(files[i].fd, texts[i])) files[i].fd = -1;
      files[i].revents = 0;
    }
    on_news(output);
  }
  return true;
}

absl::StatusOr<ExitStatus> Child::Wait(absl::Time deadline) {
  const int no_wait = deadline == absl::InfiniteFuture() ? 0 : WNOHANG;
  while (true) {
    // WNOWAIT: it is not reaped yet, so that its pid stays its own while another thread may call Kill.
    siginfo_t info = {};
    const int result = waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOWAIT | no_wait);
    if (result == 0 && info.si_pid != 0) break;
    if (result != 0 && errno != EINTR) break;  // reaping tells
    if (rpc::MonotonicNow() > deadline) return absl::DeadlineExceededError("it has not ended");
    if (no_wait != 0) poll(nullptr, 0, Milliseconds(kEndInterval));
  }
  absl::MutexLock lock(&mutex_);
  is_reaped_ = true;
  int status = 0;
  if (waitpid(pid_, &status, 0) != pid_)
    return absl::InternalError(absl::StrCat("cannot wait for it: ", std::strerror(errno)));
  if (WIFSIGNALED(status)) return ExitStatus{.signal = WTERMSIG(status)};
  return ExitStatus{.code = WEXITSTATUS(status)};
}

void Child::Kill() {
  absl::MutexLock lock(&mutex_);
  if (!is_reaped_) kill(own_group_ ? -pid_ : pid_, SIGKILL);
}

}  // namespace lumifold::subprocess
