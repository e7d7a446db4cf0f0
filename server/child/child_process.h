#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "proto/subprocess/child.h"
#include "server/job/ids.h"

namespace lumifold::server {

struct ChildProcessOptions {
  /// The program to start; its main passes the arguments to the function of the command.
  std::string program = "/proc/self/exe";
  /// Name of the ledger's store, see ledger::OpenJobStore; the child gets it in its environment.
  std::string store = {};
  int threads = 1;
  /// Limit of the child's address space in bytes; 0 for none.
  uint64_t memory_limit_bytes = 0;
  /// A child that runs longer is killed.
  absl::Duration time_limit = absl::InfiniteDuration();
};

/// Runs the program for one task in a child process, so that the coordinator survives a child that runs out
/// of memory or crashes. The child's side is in child_task.h.
/// Threads: Run from one thread at a time, so that at most one child runs; the others from any.
class ChildProcess {
 public:
  explicit ChildProcess(ChildProcessOptions options) : options_(std::move(options)) {}

  /// Starts the program with `command`, a data folder, the threads, the limit of memory and `arguments`, and
  /// returns the child's answer; blocks. `task`: for errors.
  /// Errors: those that the child answers; kInternal naming the signal that ended it; kDeadlineExceeded after
  /// the time limit; kCancelled after Cancel, and after CancelJob of this job while it runs; kUnavailable
  /// where the machine has no process, descriptor or memory left.
  absl::StatusOr<std::string> Run(const std::string& command, const std::string& root,
                                  const std::vector<std::string>& arguments, const job::JobId& job,
                                  const std::string& task);
  /// Makes a running Run of this job return as soon as possible. No effect on later calls.
  void CancelJob(const job::JobId& job);
  /// Makes a running Run return as soon as possible, and every later call at once.
  void Cancel();

 private:
  const ChildProcessOptions options_;
  absl::Mutex mutex_;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  job::JobId job_ ABSL_GUARDED_BY(mutex_);  // of the child that runs
  bool job_cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  subprocess::Child* running_ ABSL_GUARDED_BY(mutex_) = nullptr;
};

}  // namespace lumifold::server
