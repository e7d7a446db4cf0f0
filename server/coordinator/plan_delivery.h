#pragma once

#include "server/commit/committer.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"

namespace lumifold::server {

/// How a job gets its plan. A plan unit is leased, accepted, lost and failed like any other. What it delivers
/// is committed with the job's spec in one transaction of the ledger: after a crash before it the plan unit
/// is leased again, after a crash behind it the job has this plan.
/// Threads: safe.
class PlanDelivery {
 public:
  /// All must outlive it.
  PlanDelivery(const Resources* resources, FarmState* state, Committer* committer)
      : resources_(resources), state_(state), committer_(committer) {}

  /// See WorkerApi::DeliverPlan.
  absl::Status Deliver(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                       const v1::Plan& plan) const;

 private:
  /// Writes the plan of a job to the disk and the ledger. On the committer's thread.
  absl::Status Record(const job::JobId& job, const v1::JobSpec& planned) const;
  /// The plan of an accepted unit is recorded, or cannot be.
  void OnRecorded(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                  const v1::JobSpec& planned, const absl::Status& status) const;

  const Resources* const resources_;
  FarmState* const state_;
  Committer* const committer_;
};

}  // namespace lumifold::server
