#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <iostream>
#include <new>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "filter/image/exr_io.h"
#include "filter/image/memory.h"
#include "proto/rpc/byte_stream.h"
#include "server/finish_frame.h"
#include "server/frame_finisher.h"
#include "server/ledger/sqlite_job_store.h"

// The child writes its answer to standard output: on success a serialised StageTimes; otherwise the number of
// the status code, a space and the message, with exit code 1.

namespace lumifold::server {
namespace {

constexpr int kFailed = 1;

absl::Status SystemError(const char* what, int error) {
  return absl::UnavailableError(absl::StrCat(what, ": ", std::strerror(error)));
}

struct Child {
  pid_t pid = -1;
  rpc::FileHandle output;
};

absl::StatusOr<Child> Spawn(const std::vector<std::string>& command) {
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

  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& word : command)
    arguments.push_back(const_cast<char*>(word.c_str()));  // execve takes char*, but does not write to it
  arguments.push_back(nullptr);
  const int error = posix_spawn(&child.pid, arguments[0], &actions, &attributes, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  if (error != 0) return SystemError(command[0].c_str(), error);
  return child;
}

std::string ReadAll(const rpc::FileHandle& file) {
  std::string text;
  std::array<char, 4096> buffer;
  while (true) {
    const ssize_t n = read(file.get(), buffer.data(), buffer.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return text;
    text.append(buffer.data(), static_cast<size_t>(n));
  }
}

absl::StatusOr<v1::StageTimes> ReadAnswer(const std::string& answer, int wait_status) {
  if (WIFSIGNALED(wait_status)) {
    return absl::InternalError(absl::StrCat("the filter process was ended by signal ", WTERMSIG(wait_status),
                                            " (", strsignal(WTERMSIG(wait_status)), ")"));
  }
  v1::StageTimes times;
  if (WEXITSTATUS(wait_status) == 0 && times.ParseFromString(answer)) return times;
  const size_t space = answer.find(' ');
  int code = 0;
  if (space == std::string::npos || !absl::SimpleAtoi(answer.substr(0, space), &code) || code == 0) {
    return absl::InternalError(
        absl::StrCat("the filter process ended with code ", WEXITSTATUS(wait_status), " and no answer"));
  }
  return absl::Status(static_cast<absl::StatusCode>(code), answer.substr(space + 1));
}

class ChildProcessFinisher final : public FrameFinisher {
 public:
  ChildProcessFinisher(const DataFolder& folder, const ChildProcessOptions& options)
      : folder_(folder), options_(options) {}

  absl::StatusOr<v1::StageTimes> Finish(const job::JobId& job, int32_t frame) override;
  void Cancel() override;

 private:
  const DataFolder folder_;
  const ChildProcessOptions options_;
  absl::Mutex mutex_;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  pid_t running_ ABSL_GUARDED_BY(mutex_) =
      -1;  // reset before the child is reaped, so that no other process is killed
};

absl::StatusOr<v1::StageTimes> ChildProcessFinisher::Finish(const job::JobId& job, int32_t frame) {
  absl::StatusOr<Child> child;
  {
    absl::MutexLock lock(&mutex_);
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    child = Spawn({options_.program, kFinishFrameCommand, folder_.root(), job.value(), absl::StrCat(frame),
                   absl::StrCat(options_.threads), absl::StrCat(options_.memory_limit_bytes)});
    if (!child.ok()) return child.status();
    running_ = child->pid;
  }
  const std::string answer = ReadAll(child->output);
  // WNOWAIT: the child is not reaped yet, so that its pid stays valid while Cancel may use it.
  siginfo_t info;
  while (waitid(P_PID, static_cast<id_t>(child->pid), &info, WEXITED | WNOWAIT) != 0 && errno == EINTR) {
  }
  absl::MutexLock lock(&mutex_);
  running_ = -1;
  int wait_status = 0;
  waitpid(child->pid, &wait_status, 0);
  if (cancelled_) return absl::CancelledError("the coordinator is stopping");
  return ReadAnswer(answer, wait_status);
}

void ChildProcessFinisher::Cancel() {
  absl::MutexLock lock(&mutex_);
  cancelled_ = true;
  if (running_ > 0) kill(running_, SIGKILL);
}

absl::Status LimitThisProcess(uint64_t memory_limit_bytes) {
  // If the coordinator is killed, this frame is finished again after its restart.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const int niceness = getpriority(PRIO_PROCESS, 0);
  if (niceness < kChildNiceness && setpriority(PRIO_PROCESS, 0, kChildNiceness) != 0)
    return SystemError("setpriority", errno);
  if (memory_limit_bytes == 0) return absl::OkStatus();
  const rlimit limit = {memory_limit_bytes, memory_limit_bytes};
  if (setrlimit(RLIMIT_AS, &limit) != 0) return SystemError("setrlimit", errno);
  return absl::OkStatus();
}

absl::StatusOr<v1::StageTimes> FinishAsChild(const std::vector<std::string>& arguments) {
  int32_t frame = 0;
  int threads = 0;
  uint64_t memory_limit_bytes = 0;
  if (arguments.size() != 5 || !absl::SimpleAtoi(arguments[2], &frame) ||
      !absl::SimpleAtoi(arguments[3], &threads) || threads < 1 ||
      !absl::SimpleAtoi(arguments[4], &memory_limit_bytes)) {
    return absl::InvalidArgumentError("finish-frame: only the coordinator starts this command");
  }
  if (absl::Status status = LimitThisProcess(memory_limit_bytes); !status.ok()) return status;
  const DataFolder folder(arguments[0]);
  const absl::StatusOr<std::unique_ptr<ledger::JobStore>> store =
      ledger::OpenSqliteJobStore(folder.LedgerPath());
  if (!store.ok()) return store.status();
  KeepFreedMemory();
  SetExrThreads(threads);
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(threads);
  try {
    return FinishFrame(folder, **store, job::JobId(arguments[1]), frame, pool.get(), absl::Now);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat("filtering frame ", frame, ": out of memory (limit ",
                                                     memory_limit_bytes >> 20, " MiB, 0 for none)"));
  }
}

}  // namespace

std::unique_ptr<FrameFinisher> MakeChildProcessFinisher(const DataFolder& folder,
                                                        const ChildProcessOptions& options) {
  return std::make_unique<ChildProcessFinisher>(folder, options);
}

int RunFinishFrameProcess(const std::vector<std::string>& arguments) {
  const absl::StatusOr<v1::StageTimes> times = FinishAsChild(arguments);
  if (times.ok()) {
    std::cout << times->SerializeAsString() << std::flush;
    return 0;
  }
  std::cout << static_cast<int>(times.status().code()) << ' ' << std::string(times.status().message())
            << std::flush;
  return kFailed;
}

}  // namespace lumifold::server
