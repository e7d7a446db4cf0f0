#pragma once

#include <list>
#include <optional>
#include <string>
#include <thread>

#include "absl/status/statusor.h"
#include "proto/threads/event.h"
#include "server/commit/committer.h"
#include "server/coordinator/cleanup.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"

namespace lumifold::server {

/// Where the file is that is made of a part of a frame.
std::string PathOf(const DataFolder& folder, const FramePart& part);
std::optional<double> EstimatedErrorOf(const v1::FrameReport& report);

/// Has frames finished and rounds estimated, as many at a time as FrameQueue says, and records what comes of
/// it.
/// Threads: one of its own, and one for each frame that is being finished.
class FrameFinishing {
 public:
  /// All must outlive it. `wake_up` says that frames may be due.
  FrameFinishing(Resources* resources, FarmState* state, Committer* committer, Cleanup* cleanup,
                 threads::Event* wake_up);
  void Start();
  /// Once the farm is stopping and the finisher cancelled.
  void Join();
  /// A frame is finished, here or by a worker, or that has failed; it is still running in FrameQueue.
  void OnFinished(DueFrame frame, const absl::StatusOr<v1::FrameReport>& report);
  /// Seconds of all stages of finishing.
  static double SumOf(const v1::StageTimes& times);

 private:
  struct Running {
    std::thread thread;
    threads::Event has_ended;
  };

  void Run();
  /// Waits for a frame that may be finished; nullopt once the coordinator is stopping.
  std::optional<RunningFrame> Next();
  /// The next one that may be finished here now, once workers have all that are for them; nullopt, and how
  /// long there is nothing to do, if there is none.
  std::optional<RunningFrame> Begin(absl::Duration* pause);
  /// Joins the threads of frames that are finished.
  void JoinEnded();
  void FinishFrame(const RunningFrame& frame);
  /// Finds the workers faulty that delivered another result of the frame than this coordinator has made.
  void JudgeClaims(const RunningFrame& frame, const v1::FrameReport& report);
  absl::StatusOr<v1::FrameReport> RunFinisher(const RunningFrame& frame);
  /// This coordinator has filtered a block, or has failed.
  void OnBlock(const FramePart& block, int threads, const absl::StatusOr<v1::FrameReport>& report);
  void RetryFrame(Farm* farm, DueFrame frame, const absl::Status& error);
  void AwaitStorage(Farm* farm, DueFrame frame, const absl::Status& error);
  /// Opens the rounds that the frame's record has.
  void OnRoundEstimated(const DueFrame& frame, const v1::FrameReport& report);
  void OnFrameRecorded(const DueFrame& frame, const v1::FrameReport& report, const absl::Status& status);

  Resources* const resources_;
  FarmState* const state_;
  Committer* const committer_;
  Cleanup* const cleanup_;
  threads::Event* const wake_up_;
  std::list<Running> running_;  // of the thread
  std::thread thread_;
};

}  // namespace lumifold::server
