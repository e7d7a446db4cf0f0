#pragma once

#include <string>

#include "lumifold/v1/job.pb.h"
#include "server/job/ids.h"
#include "server/job/tile_grid.h"
#include "server/scheduler/frames.h"
#include "server/scheduler/leasing.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// Jobs, from Add to End.
///
/// Plan: a job that needs one (server/job/plan.h) has one unit, its plan unit, until Units::SetPlan divides
/// it into the units of its frames. Loss, failure and quarantine hold for it as for any unit; it is not
/// audited.
///
/// Tags: only workers that have all tags of a job lease its units.
///
/// Threads: one at a time.
class Jobs {
 public:
  /// All must outlive it.
  Jobs(State* state, Frames* frames, Leasing* leasing);

  /// Adds a job with a normalised spec and a new id. After a restart `options.numeric_class` is the class
  /// that the job is bound to.
  void Add(const job::JobId& job, const v1::JobSpec& spec, const JobOptions& options = {});
  /// Removes the job; its leases are revoked.
  void End(const job::JobId& job);
  bool Has(const job::JobId& job) const { return state_->jobs.Find(job) != nullptr; }

  /// A paused job gets no new leases; the units that it has are still accepted. These three have no effect on
  /// an unknown job.
  void Pause(const job::JobId& job);
  void Resume(const job::JobId& job);
  void SetPriority(const job::JobId& job, int priority);
  /// See JobOptions::turn; no effect on an unknown job.
  void SetTurn(const job::JobId& job, int64_t turn);
  /// The least turn of the active jobs that have the user and priority of this one. O(jobs).
  int64_t TurnOfFirst(const job::JobId& job) const;

  /// The job must be known, here and below.
  JobProgress Progress(const job::JobId& job) const;
  /// The class the job is bound to; empty before its first accepted unit.
  const std::string& NumericClassOf(const job::JobId& job) const;
  const v1::JobSpec& SpecOf(const job::JobId& job) const;
  const job::FrameUnits& UnitsOf(const job::JobId& job) const;

 private:
  State* const state_;
  Frames* const frames_;
  Leasing* const leasing_;
};

}  // namespace lumifold::scheduler
