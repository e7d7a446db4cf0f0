#pragma once

#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/synchronization/mutex.h"
#include "server/commit/committer.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/job_queries.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"

namespace lumifold::server {

/// What operators change: how jobs are scheduled and which workers get leases, in the ledger first.
/// Threads: safe.
class OperatorCalls final : public OperatorApi {
 public:
  /// All must outlive it.
  OperatorCalls(Resources* resources, FarmState* state, Committer* committer, JobQueries* queries)
      : resources_(resources), state_(state), committer_(committer), queries_(queries) {}

  /// Held while the scheduling of a job is changed. Taken before FarmState's lock.
  absl::Mutex& changes() { return mutex_; }

  absl::StatusOr<v1::JobStatus> PauseJob(const std::string& job_id) override;
  absl::StatusOr<v1::JobStatus> ResumeJob(const std::string& job_id) override;
  absl::StatusOr<v1::JobStatus> SetJobPriority(const v1::SetJobPriorityRequest& request) override;
  absl::StatusOr<v1::ListWorkersResponse> ListWorkers(const v1::ListWorkersRequest& request) override;
  absl::StatusOr<v1::WorkerStatus> DrainWorker(const v1::WorkerRequest& request) override;
  absl::StatusOr<v1::WorkerStatus> BlockWorker(const v1::WorkerRequest& request) override;
  absl::StatusOr<v1::WorkerStatus> ReadmitWorker(const v1::WorkerRequest& request) override;

  /// Blocks the workers that the ledger has as blocked, and no others: this coordinator before its start, or
  /// another one, has changed them. Errors: those of the ledger.
  absl::Status ReadBlockedWorkers();

 private:
  /// Changes how an active job is scheduled, in the ledger first.
  absl::StatusOr<v1::JobStatus> ChangeScheduling(const std::string& job_id,
                                                 absl::FunctionRef<void(v1::Scheduling*)> change);
  /// Records the scheduling where `recover` reads it.
  void RecordScheduling(const job::JobId& job, const v1::Scheduling& scheduling);
  /// Carries out a change that is recorded.
  void Reschedule(Farm* farm, ActiveJob* active, const v1::Scheduling& scheduling) const;

  Resources* const resources_;
  FarmState* const state_;
  Committer* const committer_;
  JobQueries* const queries_;
  /// One change of a job's scheduling or of the blocked workers at a time, in the ledger and in the farm.
  /// Taken before the farm's lock.
  absl::Mutex mutex_;
};

}  // namespace lumifold::server
