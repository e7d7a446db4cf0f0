#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "proto/device/device_process.h"
#include "proto/subprocess/child.h"
#include "server/job/ids.h"

namespace lumifold::server {

struct ChildProcessOptions {
  /// The program to start; its main passes the arguments to the function of the command.
  std::string program = "/proc/self/exe";
  /// Name of the ledger's store, see ledger::OpenJobStore; the child gets it in its environment.
  std::string store = {};
  /// Limit of the child's address space in bytes; 0 for none.
  uint64_t memory_limit_bytes = 0;
  /// A child that runs longer is killed.
  absl::Duration time_limit = absl::InfiniteDuration();
  /// Filters for the children; null: the processor does.
  std::shared_ptr<device::DeviceProcess> device = nullptr;
};

/// What a child is to do.
struct ChildWork {
  /// First argument; the data folder, `threads`, the limit of memory and kOnDevice follow, then `arguments`.
  std::string command;
  std::string root;
  int threads = 1;
  std::vector<std::string> arguments;
  job::JobId job;
  /// For errors.
  std::string task;
  /// Is told the share of it that is done, in steps of a per cent, on the thread of Run; null: nobody is.
  std::function<void(double share)> progress = nullptr;
};

/// Runs the program for a task in a child process, so that the coordinator survives a child that runs out of
/// memory or crashes. The child's side is in child_task.h.
/// Threads: safe; as many children run as threads call Run.
class ChildProcess {
 public:
  explicit ChildProcess(ChildProcessOptions options) : options_(std::move(options)) {}

  /// Starts the program and returns the child's answer; blocks.
  /// Errors: those that the child answers; kInternal naming the signal that ended it; kDeadlineExceeded after
  /// the time limit; kCancelled after Cancel, and after CancelJob of this job while it runs; kUnavailable
  /// where the machine has no process, descriptor or memory left.
  absl::StatusOr<std::string> Run(const ChildWork& work);
  /// Makes every running Run of this job return as soon as possible. No effect on later calls.
  void CancelJob(const job::JobId& job);
  /// Makes every running Run return as soon as possible, and every later call at once.
  void Cancel();

 private:
  struct Running {
    job::JobId job;
    subprocess::Child* child = nullptr;
    bool is_cancelled = false;
  };

  const ChildProcessOptions options_;
  absl::Mutex mutex_;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  std::list<Running> running_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::server
