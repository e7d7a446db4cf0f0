#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "absl/types/span.h"
#include "filter/image/rect.h"
#include "lumifold/v1/job.pb.h"
#include "server/job/tile_grid.h"
#include "server/job/unit.h"
#include "server/scheduler/lease_table.h"
#include "server/scheduler/worker_pool.h"

namespace lumifold::scheduler {

struct SchedulerOptions {
  /// Time from the grant or renewal of a lease to its expiry.
  absl::Duration lease = absl::Seconds(30);
  /// A job fails when one of its units has failed this many times.
  int max_failures = 3;
  /// Attempt of the first lease. After a restart it must be above all attempts granted before.
  job::Attempt first_attempt{1};
};

/// A new lease.
struct GrantedLease {
  job::WorkerId worker;
  job::UnitRef unit;
  job::Attempt attempt;
  Rect rect;
  SampleRange samples;
};

/// A lease that became void because its deadline passed.
struct ExpiredLease {
  job::UnitRef unit;
  job::WorkerId worker;
};

/// Outcome of the delivery of a unit.
enum class Completion {
  kAccepted,   // the lease was valid: the caller commits the unit and then calls UnitCommitted
  kDuplicate,  // the unit is already accepted or committed
  kStale,      // the lease is void or belongs to another worker
  kUnknown,    // no such unit, or the job has ended
};

/// Outcome of the failure of a unit.
enum class FailureOutcome {
  kRetried,   // the unit is free again
  kJobFails,  // too many failures, or a permanent one: the caller ends the job
  kIgnored,   // the lease was already void
};

/// Progress of an active job.
struct JobProgress {
  v1::JobState state = v1::JOB_STATE_QUEUED;
  int64_t units_done = 0;
  int64_t units_total = 0;
  int64_t samples_done = 0;
  int64_t samples_total = 0;
  int frames_done = 0;
  int frames_total = 0;
  int workers = 0;
};

/// Assigns units to workers. Pure state and policy: no clock, no threads, no disk. The state is a function of
/// the calls so far, so that a test can replay any history. Holds active jobs only.
///
/// A unit is free, leased, accepted (delivered, not yet committed) or committed. Only a free unit is leased,
/// only a leased unit is accepted, only an accepted unit is committed; accepted and committed units never
/// become free again. This is the exactly-once promise.
///
/// Numeric class: all units of a job are of one class, that of its first accepted unit. Until then workers of
/// all classes may lease its units; then the leases of the other classes become void.
///
/// Order: jobs as they were added; frames by number; within a frame as FrameUnits numbers its units. A unit
/// whose lease became void is granted before units that were never leased, but not to the worker that failed
/// it last while another worker of the same class is connected. Where several workers are free, the one that was added first gets
/// the unit.
///
/// Time: O(log n) for each unit, lease and worker that a call names, returns or changes; n counts jobs, leases
/// and workers. Calls about the state of a job take time linear in its leases.
/// Memory: one bit for each unit of the active frames, plus the leases.
/// Threads: one at a time.
class Scheduler {
 public:
  explicit Scheduler(const SchedulerOptions& options);

  /// Adds a job with a normalised spec and a new id. `numeric_class` is empty unless the job was bound to a
  /// class before a restart.
  void AddJob(const job::JobId& job, const v1::JobSpec& spec, const std::string& numeric_class = "");
  /// Restores a unit that was committed before a restart. Call it before any lease of the job. False for a
  /// unit that the job does not have.
  bool RestoreCommittedUnit(const job::UnitRef& unit);
  /// Restores a frame whose result was written before a restart. Call it before any lease of the job and
  /// before the committed units of the frame. False for a frame that the job does not have.
  bool RestoreFinishedFrame(const job::JobId& job, int32_t frame);
  /// Removes the job; its leases become void.
  void EndJob(const job::JobId& job);
  bool HasJob(const job::JobId& job) const { return jobs_by_id_.contains(job); }

  /// Adds a worker with a new id. `slots` >= 1 is the maximum number of its units that are leased or accepted
  /// at a time.
  void AddWorker(job::WorkerId worker, const std::string& numeric_class, int slots);
  /// Removes a worker; its leases become void at once.
  void RemoveWorker(job::WorkerId worker);
  /// Renews the worker's leases that are in `held` and voids the others, except leases with an attempt above
  /// `newest`, the last attempt that the worker had received when it sent the heartbeat.
  void Heartbeat(job::WorkerId worker, absl::Span<const std::pair<job::UnitRef, job::Attempt>> held,
                 job::Attempt newest, absl::Time now);
  /// Voids leases whose deadline is not after `now`. Their workers get no new leases until their next
  /// heartbeat.
  std::vector<ExpiredLease> ExpireLeases(absl::Time now);
  /// Earliest deadline of a lease; InfiniteFuture without leases.
  absl::Time NextExpiry() const;

  /// Grants leases until all slots are full or no unit is free; the leases of a worker are consecutive.
  std::vector<GrantedLease> GrantLeases(absl::Time now);
  /// Grants leases to one worker.
  std::vector<GrantedLease> GrantLeases(job::WorkerId worker, absl::Time now);
  bool HoldsLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) const;
  /// Records that a worker delivered a complete unit.
  Completion CompleteUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt);
  /// Records that an accepted unit is committed. True when it was the last unit of its frame.
  bool UnitCommitted(const job::UnitRef& unit);
  FailureOutcome FailUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                          bool permanent);

  /// Frames of the job whose units are all committed and whose result is not written.
  std::vector<int32_t> CommittedFrames(const job::JobId& job) const;
  /// Records that the result of a committed frame is written. True when it was the last frame of the job.
  bool FrameFinished(const job::JobId& job, int32_t frame);

  /// The job must be known.
  JobProgress Progress(const job::JobId& job) const;
  /// The class the job is bound to; empty before its first accepted unit. The job must be known.
  const std::string& NumericClassOf(const job::JobId& job) const;
  const v1::JobSpec& SpecOf(const job::JobId& job) const;
  const job::FrameUnits& UnitsOf(const job::JobId& job) const;

 private:
  struct Frame {
    std::vector<bool> taken;  // accepted or committed, by unit number
    int64_t committed = 0;
  };
  struct Failures {
    int count = 0;
    job::WorkerId last;
  };
  struct Job {
    job::JobId id;
    v1::JobSpec spec;
    job::FrameUnits units;
    std::string numeric_class;
    std::map<int, Frame> frames;  // active frames, by index
    std::vector<bool> finished;   // by frame
    int finished_count = 0;
    int64_t committed_units = 0;
    int64_t committed_samples = 0;
    Place next_unleased;       // units from here on were never leased
    std::set<Place> returned;  // leased once, free again
    std::map<Place, Failures> failures;
  };
  // What one call of GrantLeases may still look at in vain, see kMaxSkipped.
  using SkipBudget = int;

  Job* FindJob(const job::JobId& id);
  const Job& GetJob(const job::JobId& id) const;
  std::optional<UnitIndex> IndexOf(const job::UnitRef& unit) const;
  job::UnitRef RefOf(const UnitIndex& index) const;
  Frame& ActiveFrame(Job& job, int frame);
  const Lease* FindLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) const;
  void Bind(int64_t job_number, const std::string& numeric_class);
  void CountCommitted(Job& job, const Place& place);

  /// Ready jobs are those that may have free units. Enters the job among them, or removes it.
  void UpdateReady(int64_t number, const Job& job);
  void RemoveReady(int64_t number, const Job& job);
  bool HasReady(const std::string& numeric_class) const;
  /// The first ready job after `number` whose units workers of the class may lease.
  std::optional<int64_t> NextReady(const std::string& numeric_class, int64_t number) const;

  void GrantTo(job::WorkerId worker, absl::Time now, std::vector<GrantedLease>* granted);
  std::optional<Place> TakeUnit(Job& job, job::WorkerId worker, SkipBudget* budget);
  std::optional<Place> TakeReturnedUnit(Job& job, job::WorkerId worker, SkipBudget* budget);
  std::optional<Place> TakeUnleasedUnit(Job& job);
  bool IsExcluded(const Job& job, const Place& place, job::WorkerId worker) const;
  GrantedLease Grant(int64_t job_number, Job& job, const Place& place, job::WorkerId worker, absl::Time now);
  void VoidLease(job::Attempt attempt);

  const SchedulerOptions options_;
  int64_t next_attempt_;
  int64_t next_job_ = 0;
  std::map<int64_t, Job> jobs_;  // by order of arrival
  std::map<job::JobId, int64_t> jobs_by_id_;
  std::map<std::string, std::set<int64_t>> ready_;  // jobs by numeric class, "" for any; never empty
  WorkerPool workers_;
  LeaseTable leases_;
  std::map<UnitIndex, job::WorkerId> accepted_;
};

}  // namespace lumifold::scheduler
