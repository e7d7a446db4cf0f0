#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "filter/image/filtered_picture.h"
#include "lumifold/v1/job.pb.h"
#include "server/child/child_process.h"
#include "server/finish/estimate_round.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::filter {
class FilterDevice;
}  // namespace lumifold::filter

namespace lumifold::server {

/// Runs FinishFrame, FilterBlock and EstimateRound, on so many threads.
/// Threads: safe; a frame is finished once at a time, its blocks before.
class FrameFinisher {
 public:
  virtual ~FrameFinisher() = default;

  /// Writes the frame's result; blocks. `blocks`: those that DataFolder::BlockPath has. `progress` is told
  /// how far the filter is.
  /// Errors: as FinishFrame; kCancelled after Cancel, and after CancelJob of this job while it runs.
  virtual absl::StatusOr<v1::FrameReport> Finish(const ledger::OwnedJob& job, int32_t frame, int threads,
                                                 const std::vector<int>& blocks,
                                                 const FilterProgress& progress) = 0;

  /// Writes the picture of one block of the frame to DataFolder::BlockPath; blocks.
  /// Errors: as Finish.
  virtual absl::StatusOr<v1::FrameReport> Filter(const ledger::OwnedJob& job, int32_t frame, int block,
                                                 int threads) = 0;

  /// Adds the estimate of a round to the frame's record; blocks.
  /// Errors: as EstimateRound; otherwise as Finish.
  virtual absl::StatusOr<v1::FrameReport> Estimate(const RoundToEstimate& round, int threads) = 0;

  /// Makes every running call of this job return as soon as possible. No effect on later calls.
  virtual void CancelJob(const job::JobId& job) = 0;

  /// Makes every running call return as soon as possible, and every later call at once.
  virtual void Cancel() = 0;
};

/// Finishes frames in this process, on the calling thread and others, at the priority of the process. Neither
/// Cancel nor CancelJob interrupts a running Finish. `store` must outlive it. `device` filters; null: the
/// processor does.
std::unique_ptr<FrameFinisher> MakeInProcessFinisher(const DataFolder& folder, ledger::JobStore* store,
                                                     std::function<absl::Time()> now,
                                                     std::shared_ptr<filter::FilterDevice> device = nullptr);

/// Whether finishing a frame failed for a cause that may go away: the process was killed, or there was no
/// memory. kUnavailable, a disk or machine without space, descriptors or processes, is no failure of the
/// frame at all: it is waited for. Other errors would come again.
bool IsWorthRetrying(const absl::Status& status);

/// Finishes each frame in a child process. Errors of Finish: also those of ChildProcess::Run.
std::unique_ptr<FrameFinisher> MakeChildProcessFinisher(const DataFolder& folder,
                                                        const ChildProcessOptions& options);

/// First argument of a child process.
inline constexpr char kFinishFrameCommand[] = "finish-frame";

/// The main function of a child process: `arguments` are those after kFinishFrameCommand. Returns the exit
/// code.
int RunFinishFrameProcess(const std::vector<std::string>& arguments);

}  // namespace lumifold::server
