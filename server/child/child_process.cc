#include "server/child/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <optional>
#include <string_view>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/byte_stream.h"
#include "server/ledger/open_job_store.h"

namespace lumifold::server {
namespace {

using SteadyTime = std::chrono::steady_clock::time_point;

SteadyTime DeadlineAfter(absl::Duration limit) {
  constexpr absl::Duration kForever = absl::Hours(24 * 365 * 10);
  return std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(std::min(limit, kForever));
}

/// A machine that has no descriptor, process or memory left may have one later.
absl::Status SystemError(const char* what, int error) {
  const bool may_pass = error == EMFILE || error == ENFILE || error == EAGAIN || error == ENOMEM;
  const std::string text = absl::StrCat(what, ": ", std::strerror(error));
  return may_pass ? absl::UnavailableError(text) : absl::InternalError(text);
}

struct Child {
  pid_t pid = -1;
  rpc::FileHandle output;
};

/// Pointers to the words, and a null pointer. execve takes char*, but does not write to it.
std::vector<char*> PointersTo(const std::vector<std::string>& words) {
  std::vector<char*> pointers;
  pointers.reserve(words.size() + 1);
  for (const std::string& word : words) pointers.push_back(const_cast<char*>(word.c_str()));
  pointers.push_back(nullptr);
  return pointers;
}

/// This process's environment, with the name of the store.
std::vector<std::string> EnvironmentWith(const std::string& store) {
  const std::string prefix = absl::StrCat(ledger::kStoreVariable, "=");
  std::vector<std::string> variables = {prefix + store};
  for (char** variable = environ; *variable != nullptr; ++variable) {
    if (!std::string_view(*variable).starts_with(prefix)) variables.emplace_back(*variable);
  }
  return variables;
}

absl::StatusOr<Child> Spawn(const std::vector<std::string>& command, const std::string& store) {
  std::array<int, 2> ends = {-1, -1};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) return SystemError("pipe", errno);
  Child child{.output = rpc::FileHandle(ends[0])};
  const rpc::FileHandle write_end(ends[1]);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, write_end.get(), STDOUT_FILENO);
  // The coordinator blocks the signals it waits for; the child must not inherit that.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);

  const std::vector<std::string> environment = EnvironmentWith(store);
  const int error = posix_spawn(&child.pid, command[0].c_str(), &actions, &attributes,
                                PointersTo(command).data(), PointersTo(environment).data());
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  if (error != 0) return SystemError(command[0].c_str(), error);
  return child;
}

/// Waits until the file has data or ends; false after `deadline`.
bool AwaitData(const rpc::FileHandle& file, SteadyTime deadline) {
  pollfd waiting = {.fd = file.get(), .events = POLLIN, .revents = 0};
  while (true) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    if (left.count() <= 0) return false;
    constexpr int64_t kLongestPoll = 60'000;
    const int ready = poll(&waiting, 1, static_cast<int>(std::min<int64_t>(left.count() + 1, kLongestPoll)));
    if (ready > 0 || (ready < 0 && errno != EINTR)) return true;  // an error shows when the file is read
  }
}

/// The content of the file up to its end; nullopt after `deadline`.
std::optional<std::string> ReadAll(const rpc::FileHandle& file, SteadyTime deadline) {
  std::string text;
  std::array<char, 4096> buffer;
  while (true) {
    if (!AwaitData(file, deadline)) return std::nullopt;
    const ssize_t n = read(file.get(), buffer.data(), buffer.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return text;
    text.append(buffer.data(), static_cast<size_t>(n));
  }
}

/// What the child wrote, or the error that it wrote: see AnswerParent().
absl::StatusOr<std::string> ReadAnswer(std::string answer, int wait_status) {
  if (WIFSIGNALED(wait_status)) {
    return absl::InternalError(absl::StrCat("the filter process was ended by signal ", WTERMSIG(wait_status),
                                            " (", strsignal(WTERMSIG(wait_status)), ")"));
  }
  if (WEXITSTATUS(wait_status) == 0) return answer;
  const size_t space = answer.find(' ');
  int code = 0;
  if (space == std::string::npos || !absl::SimpleAtoi(answer.substr(0, space), &code) || code == 0) {
    return absl::InternalError(
        absl::StrCat("the filter process ended with code ", WEXITSTATUS(wait_status), " and no answer"));
  }
  return absl::Status(static_cast<absl::StatusCode>(code), answer.substr(space + 1));
}

}  // namespace

absl::StatusOr<std::string> ChildProcess::Run(const std::string& command, const std::string& root,
                                              const std::vector<std::string>& arguments,
                                              const job::JobId& job, const std::string& task) {
  std::vector<std::string> words = {options_.program, command, root, absl::StrCat(options_.threads),
                                    absl::StrCat(options_.memory_limit_bytes)};
  words.insert(words.end(), arguments.begin(), arguments.end());
  absl::StatusOr<Child> child;
  {
    absl::MutexLock lock(&mutex_);
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    child = Spawn(words, options_.store);
    if (!child.ok()) return child.status();
    running_ = child->pid;
    job_ = job;
    job_cancelled_ = false;
  }
  std::optional<std::string> answer = ReadAll(child->output, DeadlineAfter(options_.time_limit));
  if (!answer.has_value()) kill(child->pid, SIGKILL);  // it is not reaped, so its pid is its own
  const int wait_status = Reap(child->pid);
  absl::MutexLock lock(&mutex_);
  if (cancelled_) return absl::CancelledError("the coordinator is stopping");
  if (job_cancelled_) return absl::CancelledError("the job has ended");
  if (!answer.has_value()) {
    return absl::DeadlineExceededError(absl::StrCat("the filter process of ", task, " ran longer than ",
                                                    absl::FormatDuration(options_.time_limit)));
  }
  return ReadAnswer(*std::move(answer), wait_status);
}

int ChildProcess::Reap(pid_t pid) {
  // WNOWAIT: the child is not reaped yet, so that its pid stays valid while Cancel may use it.
  siginfo_t info;
  while (waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOWAIT) != 0 && errno == EINTR) {
  }
  absl::MutexLock lock(&mutex_);
  running_ = -1;
  int wait_status = 0;
  waitpid(pid, &wait_status, 0);
  return wait_status;
}

void ChildProcess::CancelJob(const job::JobId& job) {
  absl::MutexLock lock(&mutex_);
  if (running_ <= 0 || job_ != job) return;
  job_cancelled_ = true;
  kill(running_, SIGKILL);
}

void ChildProcess::Cancel() {
  absl::MutexLock lock(&mutex_);
  cancelled_ = true;
  if (running_ > 0) kill(running_, SIGKILL);
}

}  // namespace lumifold::server
