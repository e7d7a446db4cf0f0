#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "lumifold/v1/job.pb.h"
#include "server/data_folder.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// Runs FinishFrame somewhere. Threads: Finish from one at a time, Cancel from any.
class FrameFinisher {
 public:
  virtual ~FrameFinisher() = default;

  /// Blocks until the frame's result is written, or fails. Errors: as FinishFrame; kCancelled after Cancel.
  virtual absl::StatusOr<v1::StageTimes> Finish(const scheduler::JobId& job, int32_t frame) = 0;

  /// Makes a running Finish return as soon as it can, and every later one at once.
  virtual void Cancel() = 0;
};

/// Finishes frames on the calling thread and a pool of `threads`. Cancel waits for the frame in work. `store`
/// must outlive it.
std::unique_ptr<FrameFinisher> MakeInProcessFinisher(const DataFolder& folder, ledger::JobStore* store,
                                                     int threads, std::function<absl::Time()> now);

struct ChildProcessOptions {
  /// The program to start; its main must hand the arguments to RunFinishFrameProcess.
  std::string program = "/proc/self/exe";
  int threads = 1;
  /// Address space the child may take; 0 for no limit.
  uint64_t memory_limit_bytes = 0;
};

/// Finishes each frame in a child process of low priority, so that neither its memory nor a crash of it
/// touches the coordinator.
/// Errors of Finish: also kInternal where the child died; it names the signal.
std::unique_ptr<FrameFinisher> MakeChildProcessFinisher(const DataFolder& folder,
                                                        const ChildProcessOptions& options);

/// First argument of a child process.
inline constexpr char kFinishFrameCommand[] = "finish-frame";

/// The child's side, for main: `arguments` are those after kFinishFrameCommand. Gives the exit code.
int RunFinishFrameProcess(const std::vector<std::string>& arguments);

}  // namespace lumifold::server
