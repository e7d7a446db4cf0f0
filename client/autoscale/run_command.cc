#include "client/autoscale/run_command.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <string_view>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/monotonic.h"

extern char** environ;

namespace lumifold::autoscale {
namespace {

constexpr size_t kMaxOutputBytes = size_t{64} << 20;
constexpr size_t kPieceBytes = 65536;
/// How long a closed output waits for the end of its program.
constexpr absl::Duration kPoll = absl::Milliseconds(20);

struct Pipe {
  rpc::FileHandle read;
  rpc::FileHandle write;
};

std::optional<Pipe> MakePipe() {
  std::array<int, 2> ends = {};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) return std::nullopt;
  return Pipe{rpc::FileHandle(ends[0]), rpc::FileHandle(ends[1])};
}

bool IsTakenOut(std::string_view variable, const std::vector<std::string>& changes) {
  const std::string_view name = variable.substr(0, variable.find('='));
  return std::any_of(changes.begin(), changes.end(), [name](std::string_view change) {
    if (change.ends_with('*')) return name.starts_with(change.substr(0, change.size() - 1));
    return name == change.substr(0, change.find('='));
  });
}

std::vector<std::string> ChangedEnvironment(const std::vector<std::string>& changes) {
  std::vector<std::string> variables;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    if (!IsTakenOut(*variable, changes)) variables.emplace_back(*variable);
  }
  std::copy_if(changes.begin(), changes.end(), std::back_inserter(variables),
               [](const std::string& change) { return absl::StrContains(change, '='); });
  return variables;
}

std::vector<char*> Pointers(const std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  // posix_spawn does not change them.
  for (const std::string& text : texts) pointers.push_back(const_cast<char*>(text.c_str()));
  pointers.push_back(nullptr);
  return pointers;
}

/// A child in a process group of its own. Killed with its children unless it was waited for.
class Child {
 public:
  static absl::StatusOr<Child> Start(const std::vector<std::string>& arguments,
                                     const std::vector<std::string>& environment, const Pipe& out,
                                     const Pipe& err) {
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, out.write.get(), STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, err.write.get(), STDERR_FILENO);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    const std::vector<std::string> variables = ChangedEnvironment(environment);
    pid_t pid = -1;
    const int error = posix_spawnp(&pid, arguments.front().c_str(), &actions, &attributes,
                                   Pointers(arguments).data(), Pointers(variables).data());
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    if (error != 0)
      return absl::UnavailableError(absl::StrCat("cannot run ", arguments.front(), ": ", strerror(error)));
    return Child(pid);
  }
  Child(Child&& other) noexcept : pid_(other.pid_) { other.pid_ = -1; }
  Child& operator=(Child&&) = delete;
  ~Child() {
    if (pid_ < 0) return;
    kill(-pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }

  /// The wait status, once it has ended.
  std::optional<int> Ended() {
    int status = 0;
    if (waitpid(pid_, &status, WNOHANG) != pid_) return std::nullopt;
    pid_ = -1;
    return status;
  }

 private:
  explicit Child(pid_t pid) : pid_(pid) {}
  pid_t pid_;
};

/// Reads what has arrived; false once the other end is closed.
bool ReadSome(int file, std::string* text) {
  std::array<char, kPieceBytes> piece;
  const ssize_t count = read(file, piece.data(), piece.size());
  if (count < 0 && errno == EINTR) return true;
  if (count <= 0) return false;
  text->append(piece.data(), static_cast<size_t>(count));
  return true;
}

/// Reads both until they are closed, `deadline` has passed or there is too much; true in the first case.
bool ReadAll(Pipe& out, Pipe& err, absl::Time deadline, CommandResult* result) {
  std::array<pollfd, 2> files = {{{out.read.get(), POLLIN, 0}, {err.read.get(), POLLIN, 0}}};
  const std::array<std::string*, 2> texts = {&result->out, &result->err};
  while (files[0].fd >= 0 || files[1].fd >= 0) {
    const absl::Duration left = deadline - rpc::MonotonicNow();
    if (left <= absl::ZeroDuration() || result->out.size() + result->err.size() > kMaxOutputBytes)
      return false;
    poll(files.data(), files.size(), static_cast<int>(absl::ToInt64Milliseconds(left)) + 1);
    for (size_t i = 0; i < files.size(); ++i) {
      if (files[i].fd >= 0 && files[i].revents != 0 && !ReadSome(files[i].fd, texts[i])) files[i].fd = -1;
      files[i].revents = 0;
    }
  }
  return true;
}

}  // namespace

absl::StatusOr<CommandResult> RunCommand(const std::vector<std::string>& arguments,
                                         const std::vector<std::string>& environment,
                                         absl::Duration timeout) {
  const absl::Time deadline = rpc::MonotonicNow() + timeout;
  const std::string& program = arguments.front();
  std::optional<Pipe> out = MakePipe();
  std::optional<Pipe> err = MakePipe();
  if (!out.has_value() || !err.has_value())
    return absl::UnavailableError(absl::StrCat("cannot run ", program, ": no descriptor is left"));
  absl::StatusOr<Child> child = Child::Start(arguments, environment, *out, *err);
  if (!child.ok()) return child.status();
  out->write = rpc::FileHandle();
  err->write = rpc::FileHandle();
  CommandResult result;
  if (!ReadAll(*out, *err, deadline, &result))
    return absl::UnavailableError(
        absl::StrCat(program, " took longer than ", absl::FormatDuration(timeout), ", or printed too much"));
  std::optional<int> status = child->Ended();
  for (; !status.has_value(); status = child->Ended()) {
    if (rpc::MonotonicNow() > deadline)
      return absl::UnavailableError(
          absl::StrCat(program, " took longer than ", absl::FormatDuration(timeout)));
    poll(nullptr, 0, static_cast<int>(absl::ToInt64Milliseconds(kPoll)));
  }
  if (!WIFEXITED(*status))
    return absl::UnavailableError(absl::StrCat(program, " was ended by signal ", WTERMSIG(*status)));
  result.exit_code = WEXITSTATUS(*status);
  return result;
}

}  // namespace lumifold::autoscale
