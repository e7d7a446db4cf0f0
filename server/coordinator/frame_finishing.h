#pragma once

#include <optional>
#include <thread>

#include "absl/status/statusor.h"
#include "server/commit/committer.h"
#include "server/coordinator/cleanup.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"

namespace lumifold::server {

/// Has frames finished and rounds estimated, one after the other, and records what comes of it.
/// Threads: one of its own.
class FrameFinishing {
 public:
  /// All must outlive it. `wake_up` says that frames may be due.
  FrameFinishing(Resources* resources, FarmState* state, Committer* committer, Cleanup* cleanup,
                 threads::Event* wake_up);
  void Start();
  /// Once the farm is stopping and the finisher cancelled.
  void Join();

 private:
  void Run();
  /// Waits for a frame that is due; nullopt once the coordinator is stopping.
  std::optional<DueFrame> Next();
  /// The first frame that is due now; nullopt, and how long there is nothing to do, if there is none.
  std::optional<DueFrame> TakeDue(absl::Duration* pause);
  void OnFinished(DueFrame frame, const absl::StatusOr<v1::FrameReport>& report);
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
  std::thread thread_;
};

}  // namespace lumifold::server
