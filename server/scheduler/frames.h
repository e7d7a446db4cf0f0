#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "server/job/frame_rounds.h"
#include "server/job/ids.h"
#include "server/scheduler/state.h"

namespace lumifold::scheduler {

/// The frames of the active jobs, from their first unit to their result. A frame is committed when its units
/// are, its rounds are decided, its audits are settled or waived, and no unit of it is to be revoked.
///
/// Threads: one at a time.
class Frames {
 public:
  /// `state` must outlive it.
  explicit Frames(State* state) : state_(state) {}

  /// Units of a further frame are leased only while fewer frames than this are in flight, see ReadyJobs.
  void SetMaxActive(int frames) { state_->ready.SetMaxActiveFrames(frames); }
  /// Frames that count against SetMaxActive: those that are not kept.
  int active() const { return state_->ready.active_frames(); }
  /// Frames from their first lease until Finish, of all jobs.
  int64_t in_flight() const;

  /// Sets the rounds of a frame with adaptive sampling that are decided now; those before stay as they were.
  /// Before the first call for a frame it has those of FrameRounds(spec). After a restart call it before
  /// Units::Restore for units of the frame. No effect on an unknown job or a finished frame. True when the
  /// frame is committed by this.
  bool SetRounds(const job::JobId& job, int32_t frame, std::shared_ptr<const job::FrameRounds> rounds);
  /// The rounds of a frame that is active; null for others, and without adaptive sampling.
  std::shared_ptr<const job::FrameRounds> RoundsOf(const job::JobId& job, int32_t frame) const;
  /// How many rounds from the first on are committed, with the geometry; 0 where RoundsOf is null.
  int CommittedRounds(const job::JobId& job, int32_t frame) const;

  /// Frames of the job, which is known, that are committed and whose result is not written.
  std::vector<int32_t> Committed(const job::JobId& job) const;
  /// False also for a frame of which units were revoked since it was committed.
  bool IsCommitted(const job::JobId& job, int32_t frame) const;
  /// Frames that became committed since the last call because their last audit was settled or waived;
  /// Units::Commit has not reported them.
  std::vector<std::pair<job::JobId, int32_t>> TakeSettled();
  /// Records that the result of a frame is written. True when it was the last frame of the job. No effect on
  /// a frame of which units are not committed and audited. Units that were to be revoked stay: their pixels
  /// are in the result.
  bool Finish(const job::JobId& job, int32_t frame);
  /// Restores a frame whose result was written before a restart. Call it before any lease of the job and
  /// before the committed units of the frame. False for a frame that the job does not have.
  bool RestoreFinished(const job::JobId& job, int32_t frame);

  /// The job leaves a frame out that is not finished. Call it before any lease of the job, or after
  /// Units::SetPlan; a job that is not planned has no frames. No effect on a frame that the job does not
  /// have.
  void Skip(const job::JobId& job, int32_t frame);

  // For the other parts of the scheduler.

  /// The state of a frame that is not finished; it is active from now on.
  FrameState& Open(Job& job, int frame);
  /// Counts the active frames of a job against the limit, or no more: before and after a change of whether
  /// the job is paused, or of what it requires.
  void CountActive(const Job& job, bool are_counted);
  /// The active frames of a job, which ends or is divided into other units, count no more.
  void Leave(const Job& job);
  /// Finds out whether an active frame is committed, and returns it.
  bool UpdateCommitted(Job& job, int frame);
  /// An audit of the frame has ended.
  void OnAuditEnded(Job& job, int frame);

 private:
  /// Null for an unknown job, and for a frame that is not active.
  const FrameState* Find(const job::JobId& job, int32_t frame) const;
  void ReleaseDeliverers(const FrameState& frame);

  State* const state_;
  std::vector<std::pair<job::JobId, int32_t>> settled_;
};

}  // namespace lumifold::scheduler
