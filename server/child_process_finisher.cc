#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <new>
#include <optional>
#include <string_view>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/exr_io.h"
#include "filter/image/memory.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/monotonic.h"
#include "server/estimate_round.h"
#include "server/finish_frame.h"
#include "server/frame_finisher.h"
#include "server/ledger/open_job_store.h"
#include "worker/fence/fence.h"

// The child writes its answer to standard output: on success a serialised FrameReport; otherwise the number of
// the status code, a space and the message, with exit code 1.

namespace lumifold::server {
namespace {

constexpr int kFailed = 1;
/// In place of a round: the frame's result.
constexpr int kResult = -1;

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

absl::StatusOr<v1::FrameReport> ReadAnswer(const std::string& answer, int wait_status) {
  if (WIFSIGNALED(wait_status)) {
    return absl::InternalError(absl::StrCat("the filter process was ended by signal ", WTERMSIG(wait_status),
                                            " (", strsignal(WTERMSIG(wait_status)), ")"));
  }
  v1::FrameReport report;
  if (WEXITSTATUS(wait_status) == 0 && report.ParseFromString(answer)) return report;
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

  absl::StatusOr<v1::FrameReport> Finish(const ledger::OwnedJob& job, int32_t frame) override {
    return Run({.job = job.job, .epoch = job.epoch, .frame = frame, .round = kResult, .rendered = {}});
  }
  absl::StatusOr<v1::FrameReport> Estimate(const RoundToEstimate& round) override { return Run(round); }
  void CancelJob(const job::JobId& job) override;
  void Cancel() override;

 private:
  /// Starts a child for the estimate of a round, or for the result.
  absl::StatusOr<v1::FrameReport> Run(const RoundToEstimate& what);
  /// Reaps the child that runs and returns its wait status.
  int Reap(pid_t pid) ABSL_LOCKS_EXCLUDED(mutex_);

  const DataFolder folder_;
  const ChildProcessOptions options_;
  absl::Mutex mutex_;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  job::JobId job_ ABSL_GUARDED_BY(mutex_);  // of the child that runs
  bool job_cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  pid_t running_ ABSL_GUARDED_BY(mutex_) =
      -1;  // reset before the child is reaped, so that no other process is killed
};

absl::StatusOr<v1::FrameReport> ChildProcessFinisher::Run(const RoundToEstimate& what) {
  absl::StatusOr<Child> child;
  {
    absl::MutexLock lock(&mutex_);
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    child = Spawn(
        {options_.program, kFinishFrameCommand, folder_.root(), what.job.value(), absl::StrCat(what.frame),
         absl::StrCat(options_.threads), absl::StrCat(options_.memory_limit_bytes), absl::StrCat(what.round),
         absl::StrCat(absl::ToInt64Milliseconds(what.rendered)), absl::StrCat(what.epoch.value())},
        options_.store);
    if (!child.ok()) return child.status();
    running_ = child->pid;
    job_ = what.job;
    job_cancelled_ = false;
  }
  const std::optional<std::string> answer = ReadAll(child->output, DeadlineAfter(options_.time_limit));
  if (!answer.has_value()) kill(child->pid, SIGKILL);  // it is not reaped, so its pid is its own
  const int wait_status = Reap(child->pid);
  absl::MutexLock lock(&mutex_);
  if (cancelled_) return absl::CancelledError("the coordinator is stopping");
  if (job_cancelled_) return absl::CancelledError("the job has ended");
  if (!answer.has_value()) {
    return absl::DeadlineExceededError(absl::StrCat("the filter process of frame ", what.frame,
                                                    " ran longer than ",
                                                    absl::FormatDuration(options_.time_limit)));
  }
  return ReadAnswer(*answer, wait_status);
}

int ChildProcessFinisher::Reap(pid_t pid) {
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

void ChildProcessFinisher::CancelJob(const job::JobId& job) {
  absl::MutexLock lock(&mutex_);
  if (running_ <= 0 || job_ != job) return;
  job_cancelled_ = true;
  kill(running_, SIGKILL);
}

void ChildProcessFinisher::Cancel() {
  absl::MutexLock lock(&mutex_);
  cancelled_ = true;
  if (running_ > 0) kill(running_, SIGKILL);
}

absl::Status YieldToOthers() {
  // If the coordinator is killed, this frame is finished again after its restart.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const int niceness = getpriority(PRIO_PROCESS, 0);
  if (niceness < kChildNiceness && setpriority(PRIO_PROCESS, 0, kChildNiceness) != 0)
    return SystemError("setpriority", errno);
  return absl::OkStatus();
}

/// The filter reads units, writes results and reads the ledger; the rest of the data folder has secrets. Only a ledger
/// elsewhere needs the network.
absl::Status FenceThisProcess(const DataFolder& folder, const std::string& store,
                              uint64_t memory_limit_bytes) {
  fence::FenceOptions options = {
      .keep_file_access = true,
      .memory_bytes = memory_limit_bytes,
      // The coordinator has the ledger open, so that its files are there and stay.
      .writable = {folder.root() + "/film", folder.root() + "/results", folder.LedgerPath(),
                   folder.LedgerPath() + "-wal", folder.LedgerPath() + "-shm"},
  };
  if (!store.empty() && store != ledger::kSqliteStore) {
    options.network = true;
    options.readable = {"/var/run/postgresql"};
    if (const char* const home = std::getenv("HOME"); home != nullptr)
      options.readable.insert(options.readable.end(),
                              {absl::StrCat(home, "/.postgresql"), absl::StrCat(home, "/.pgpass")});
    if (const char* const file = std::getenv("PGPASSFILE"); file != nullptr)
      options.readable.emplace_back(file);
  }
  return fence::EnterFence(options).status();
}

absl::StatusOr<v1::FrameReport> FinishAsChild(const std::vector<std::string>& arguments) {
  RoundToEstimate what;
  what.job = job::JobId(arguments.size() > 1 ? arguments[1] : "");
  int threads = 0;
  uint64_t memory_limit_bytes = 0;
  int64_t rendered_ms = 0;
  int64_t epoch = 0;
  if (arguments.size() != 8 || !absl::SimpleAtoi(arguments[5], &what.round) ||
      !absl::SimpleAtoi(arguments[6], &rendered_ms) || !absl::SimpleAtoi(arguments[7], &epoch) ||
      !absl::SimpleAtoi(arguments[2], &what.frame) || !absl::SimpleAtoi(arguments[3], &threads) ||
      threads < 1 || !absl::SimpleAtoi(arguments[4], &memory_limit_bytes)) {
    return absl::InvalidArgumentError("finish-frame: only the coordinator starts this command");
  }
  if (absl::Status status = YieldToOthers(); !status.ok()) return status;
  const DataFolder folder(arguments[0]);
  setenv("SQLITE_TMPDIR", (folder.root() + "/film").c_str(),
         /*overwrite=*/1);  // the fence leaves no other folder
  const char* const variable = std::getenv(ledger::kStoreVariable);
  const std::string store_name = variable == nullptr ? "" : variable;
  const absl::StatusOr<std::unique_ptr<ledger::JobStore>> store =
      ledger::OpenJobStore(store_name, folder.LedgerPath());
  if (!store.ok()) return store.status();
  // After the store: its address may name certificates anywhere.
  if (absl::Status status = FenceThisProcess(folder, store_name, memory_limit_bytes); !status.ok())
    return status;
  KeepFreedMemory();
  SetExrThreads(threads);
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(threads);
  try {
    what.rendered = absl::Milliseconds(rendered_ms);
    what.epoch = ledger::Epoch(epoch);
    return what.round == kResult ? FinishFrame(folder, **store, {what.job, what.epoch}, what.frame,
                                               pool.get(), rpc::MonotonicNow)
                                 : EstimateRound(folder, **store, what, pool.get(), rpc::MonotonicNow);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat("filtering frame ", what.frame,
                                                     ": out of memory (limit ", memory_limit_bytes >> 20,
                                                     " MiB, 0 for none)"));
  }
}

}  // namespace

bool IsWorthRetrying(const absl::Status& status) {
  return absl::IsInternal(status) || absl::IsResourceExhausted(status);
}

std::unique_ptr<FrameFinisher> MakeChildProcessFinisher(const DataFolder& folder,
                                                        const ChildProcessOptions& options) {
  return std::make_unique<ChildProcessFinisher>(folder, options);
}

int RunFinishFrameProcess(const std::vector<std::string>& arguments) {
  const absl::StatusOr<v1::FrameReport> report = FinishAsChild(arguments);
  if (report.ok()) {
    std::cout << report->SerializeAsString() << std::flush;
    return 0;
  }
  std::cout << static_cast<int>(report.status().code()) << ' ' << std::string(report.status().message())
            << std::flush;
  return kFailed;
}

}  // namespace lumifold::server
