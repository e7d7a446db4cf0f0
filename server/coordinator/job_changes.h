#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "proto/threads/event.h"
#include "proto/threads/task_thread.h"
#include "server/commit/committer.h"
#include "server/coordinator/cleanup.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/job_loader.h"
#include "server/coordinator/job_queries.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"
#include "server/job/reopen_plan.h"

namespace lumifold::server {

/// Changes of jobs that exist: parts are rendered again, samples are added, or the job is cancelled or
/// deleted.
///
/// A job that is changed is first suspended: it leaves the scheduler, the finisher and the committer, as if
/// it had ended. Then its logs and its row are changed, and it is restored as after a restart. A crash at any
/// point leaves the job as it was before or after the change, or with some units that are rendered again.
/// Threads: safe; changes are made one after the other on a thread of its own.
class JobChanges final : public JobChangeApi {
 public:
  struct Parts {
    Committer* committer;
    Cleanup* cleanup;
    JobLoader* loader;
    JobQueries* queries;
    absl::Mutex* scheduling;  // held while the scheduling of a job is changed
  };
  /// All must outlive it.
  JobChanges(Resources* resources, FarmState* state, const Parts& parts)
      : resources_(resources), state_(state), parts_(parts) {}

  void CancelJob(const std::string& job_id, StatusAnswer done) override;
  void RetryJob(const v1::RetryJobRequest& request, StatusAnswer done) override;
  void AddSamples(const v1::AddSamplesRequest& request, StatusAnswer done) override;
  void DeleteJob(const v1::DeleteJobRequest& request, StatusAnswer done) override;

  /// Lets a job go on without a frame that cannot be rendered; where that is not possible, it fails for
  /// `cause`. Only queues.
  void SkipFrame(const FrameKey& frame, const std::string& cause);

  /// Answers all changes that wait, and takes no more.
  void StopAnswering();
  /// Once the farm is stopping.
  void Stop();

 private:
  using Work = std::function<absl::StatusOr<v1::JobStatus>()>;

  /// Calls `work` on the thread of changes, and `done` with its outcome or when the coordinator stops.
  void Change(Work work, StatusAnswer done);
  /// As Change; false where the coordinator stops, and nothing follows.
  bool Queue(Work work, const StatusAnswer& done);
  void Answer(int64_t number, const absl::StatusOr<v1::JobStatus>& answer);
  absl::StatusOr<v1::JobStatus> Reopen(const job::JobId& job, const job::ReopenRequest& request);
  absl::StatusOr<v1::JobStatus> Delete(const job::JobId& job);
  absl::StatusOr<v1::JobStatus> CancelNow(const job::JobId& job);
  absl::StatusOr<job::ReopenPlan> PlanFor(const job::JobId& job, const job::ReopenRequest& request);
  /// Takes a job away from scheduler, finisher and committer. Errors: kUnavailable when the coordinator
  /// stops.
  absl::Status Suspend(const job::JobId& job, v1::JobStatus shown);
  /// Waits while the end of the job is being recorded.
  void AwaitEnd(const job::JobId& job);
  absl::Status ChangeFiles(const job::JobId& job, const job::ReopenPlan& plan);
  /// Makes a suspended job what the ledger says: active or ended. Waits for the storage.
  void Resume(const job::JobId& job);

  Resources* const resources_;
  FarmState* const state_;
  const Parts parts_;
  threads::Event stopping_;
  absl::Mutex mutex_;
  bool is_open_ ABSL_GUARDED_BY(mutex_) = true;
  int64_t next_change_ ABSL_GUARDED_BY(mutex_) = 1;
  /// Changes that were asked for and are not answered.
  std::map<int64_t, StatusAnswer> answers_ ABSL_GUARDED_BY(mutex_);
  threads::TaskThread thread_{threads::TaskThread::Priority::kNormal};  // last: its tasks use the others
};

}  // namespace lumifold::server
