#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/time/time.h"
#include "server/commit/accepted_unit.h"
#include "server/commit/open_logs.h"
#include "server/coordinator/finish_leases.h"
#include "server/coordinator/frame_limit.h"
#include "server/coordinator/frame_queue.h"
#include "server/coordinator/job_table.h"
#include "server/coordinator/loaded_job.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/watchers.h"
#include "server/coordinator/worker_history.h"
#include "server/coordinator/worker_table.h"
#include "server/job/dependencies.h"
#include "server/scheduler/scheduler.h"

namespace lumifold::server {

/// What a change of the farm's state leads to on the disk and on other threads. Its calls only queue: they
/// never block and never call back.
class FarmEffects {
 public:
  virtual ~FarmEffects() = default;
  /// The job has ended.
  virtual void RecordEnd(const job::JobId& job, v1::JobState state, const std::string& error) = 0;
  /// The finisher is to drop what it has of the job.
  virtual void CancelFinishing(const job::JobId& job) = 0;
  /// Units were committed with wrong pixels.
  virtual void DiscardUnits(const FrameKey& frame, const std::vector<job::UnitKey>& units) = 0;
  /// The workers of this name are blocked. After DiscardUnits for their units.
  virtual void RecordBlock(const std::string& name, const std::string& reason) = 0;
  /// A frame cannot be rendered, and its job is to go on without it. `cause`: why the job fails if it cannot.
  virtual void SkipFrame(const FrameKey& frame, const std::string& cause) = 0;
  /// Jobs that others wait for.
  virtual void KeepPrerequisites(const std::set<job::JobId>& jobs) = 0;
  /// Jobs have changed; frames may be due.
  virtual void WakeHousekeeping() = 0;
  virtual void WakeFinisher() = 0;
};

/// The state of a farm: jobs, workers, leases and frames, and the rules that concern several of them.
/// Everything that only one part decides is that part's. No lock, no disk: FarmState has the lock,
/// FarmEffects the way out.
/// Threads: one at a time.
class Farm {
 public:
  enum class Phase { kLeasing, kDraining, kStopping };

  struct Totals {
    int64_t units_committed = 0;
    int64_t samples_committed = 0;
  };

  /// Both must outlive it.
  Farm(const Resources* resources, FarmEffects* effects);

  /// A job that was just recorded becomes active. `after`: see AwaitPrerequisites.
  void StartJob(ledger::JobRecord record, const std::vector<job::Prerequisite>& after);
  /// A job becomes active that has been on the disk.
  void EnterJob(const LoadedJob& loaded);
  /// The plan of an active job, which its plan unit has made, is recorded: it divides the job.
  void SetPlan(const job::UnitRef& unit, const v1::JobSpec& planned);
  /// Ends an active job: its leases are revoked at once, its end is recorded. One that is done and skips
  /// frames is done with gaps. No effect on other jobs.
  void EndJob(const job::JobId& job, v1::JobState state, const std::string& cause);
  /// Fails a job.
  void FailJob(const job::JobId& job, const std::string& cause) { EndJob(job, v1::JOB_STATE_FAILED, cause); }
  /// A frame cannot be rendered: its job fails, or skips it.
  void FailFrame(const FrameKey& frame, const std::string& cause);
  /// An active job leaves the scheduler and the finisher, until EnterJob. `shown`: what clients see if it is
  /// not active.
  void SuspendJob(const job::JobId& job, v1::JobStatus shown);
  /// Starts or fails jobs that no longer wait for others.
  void Settle(const job::Settled& settled);
  /// Pauses or resumes leases of an active job: it runs unless its user has paused it, or it waits for other
  /// jobs or for a file. To be called when one of these changes.
  void UpdatePause(const job::JobId& job);
  /// A file of a scene is here: jobs that wait for it go on.
  void OnAssetFound(const std::string& sha256);
  /// Status of a job in memory.
  std::optional<v1::JobStatus> StatusOf(const job::JobId& job) const;
  /// Leases that an active job has or could have.
  int64_t LeasesWanted(const job::JobId& job) const;

  /// A unit is committed.
  void CountCommitted(const AcceptedUnit& unit);
  /// Units of an active job are committed no more: they are rendered again.
  void RevokeUnits(const job::JobId& job, const std::vector<ledger::UnitRecord>& units);
  /// Whether what a frame was queued for is still due.
  bool IsDue(const DueFrame& frame) const;
  /// Queues what is due for a frame: its result, or the estimate of a round.
  void QueueDue(const FrameKey& frame);
  /// Takes the next frame that may be finished now, by this coordinator or by a worker, which is told so.
  std::optional<RunningFrame> BeginFrame(absl::Time now);
  /// Ends leases to finish frames, which come back; their workers are told, and those that failed are
  /// excluded (FinishLeases::Exclude).
  enum class Return { kFailed, kHandedBack };
  void TakeFramesBack(const std::vector<job::Attempt>& leases, std::string_view reason, Return how);
  /// Bounds the frames in flight by what the machine has and all jobs demand.
  void LimitFrames(uint64_t free_disk_bytes);

  /// Asks a worker to go to another coordinator. It gets no more leases here.
  void MoveWorker(job::WorkerId worker, const std::string& to, bool at_once = false);
  /// Logs leases that are late, and fails the jobs that cannot go on because of them.
  void ReportLate(const std::vector<scheduler::LateLease>& late);
  /// Does what follows from every change: audits, revocations, grants, wake-ups. FarmState::Change calls it.
  void Complete();

  bool is_leasing() const { return phase == Phase::kLeasing; }
  bool is_stopping() const { return phase == Phase::kStopping; }

  Phase phase = Phase::kLeasing;
  scheduler::Scheduler scheduler;
  JobTable jobs;
  SubmissionTable submissions;
  job::Dependencies dependencies;
  WorkerTable workers;
  WorkerHistory history;
  FrameQueue frames;
  FinishLeases finish_leases;
  FrameLimit frame_limit;
  Watchers watchers;
  Totals totals;
  /// HOST:PORT of this coordinator, for display.
  std::string address;

 private:
  /// Lets an active job wait for others, as they are now.
  void AwaitPrerequisites(const job::JobId& job, std::vector<job::Prerequisite> after);
  void StopRendering(const job::JobId& job);
  /// Bounds the frames in flight by what this job demands too.
  void LimitFramesFor(const job::JobId& job);
  void FollowAudits();
  void SendRevoked();
  void SendFrame(const RunningFrame& frame);
  void SendGrants(const std::vector<scheduler::GrantedLease>& leases);

  const Resources* const resources_;
  FarmEffects* const effects_;
};

}  // namespace lumifold::server
