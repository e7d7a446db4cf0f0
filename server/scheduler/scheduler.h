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
  /// A lease whose progress stands still for this long is not renewed. Loading a scene reports one step for
  /// each of its files only, so it must be longer than what the largest file takes.
  absl::Duration stall = absl::Minutes(10);
  /// A unit is overdue when it has been leased for longer than `overdue_factor` times the mean of the
  /// accepted units of its job and kind, and for longer than `overdue_least`.
  double overdue_factor = 4;
  absl::Duration overdue_least = absl::Seconds(10);
  /// A job fails when one of its units has failed this many times.
  int max_failures = 3;
  /// A unit with which this many workers were lost, or twice as many times any, is in quarantine: it is
  /// leased once more, to a worker that then renders nothing else. If that is lost too, the job fails.
  int max_lost_workers = 3;
  /// A failed unit waits this long before it is leased again, twice as long after each further failure, and
  /// no longer than `longest_backoff`.
  absl::Duration first_backoff = absl::Seconds(1);
  absl::Duration longest_backoff = absl::Seconds(60);
  /// A worker that failed units of this many jobs within `set_aside`, each rendered by another worker since,
  /// gets no leases for `set_aside`.
  int max_blamed_jobs = 2;
  absl::Duration set_aside = absl::Minutes(5);
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
  /// The unit is in quarantine.
  bool alone = false;
};

/// A job that cannot go on; the caller ends it with this error.
struct FailedJob {
  job::JobId job;
  std::string error;
};

/// A lease as its worker reports it in a heartbeat.
struct HeldLease {
  job::UnitRef unit;
  job::Attempt attempt;
  /// Differs from the last report if the unit has advanced.
  int64_t progress = 0;
};

/// A worker that gets no leases for a while, because it fails units that other workers render.
struct SetAsideWorker {
  job::WorkerId worker;
  absl::Time until;
  std::string reason;
};

enum class Lateness {
  kSilent,   // the worker has not renewed the lease, which is now void
  kStalled,  // the worker renews the lease but makes no progress; the lease is now void
  kOverdue,  // the lease stays valid; the unit is leased a second time, and the first result counts
};

struct LateLease {
  job::UnitRef unit;
  job::WorkerId worker;
  Lateness lateness = Lateness::kSilent;
  /// Not empty: the job cannot go on, and the caller ends it with this error.
  std::string job_error;
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
  kRetried,   // the unit will be leased again
  kJobFails,  // too many failures, or two workers say that it is permanent: the caller ends the job
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
/// A unit is free, leased, accepted (delivered, not yet committed) or committed. Only a free or overdue unit
/// is leased, only a leased unit is accepted, only an accepted unit is committed; accepted and committed
/// units never become free again. This is the exactly-once promise. An overdue unit has up to two leases, of
/// different workers; the other one becomes void when the unit is accepted.
///
/// Numeric class: all units of a job are of one class, that of its first accepted unit. Until then workers of
/// all classes may lease its units; then the leases of the other classes become void.
///
/// Order: jobs as they were added; frames by number; within a frame as FrameUnits numbers its units. A unit
/// whose lease became void is granted before units that were never leased, but not to the worker that failed
/// it last while another worker of the same class is connected. Where several workers are free, the one that
/// was added first gets the unit.
///
/// Time: O(log n) for each unit, lease and worker that a call names, returns or changes; n counts jobs,
/// leases and workers. Calls about the state of a job take time linear in its leases.
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
  /// at a time. `name` tells one process from another, over all its connections; if it is empty, the id does.
  void AddWorker(job::WorkerId worker, const std::string& numeric_class, int slots,
                 const std::string& name = "");
  /// Removes a worker; its leases become void at once, and each counts as a loss of the worker with the unit.
  std::vector<FailedJob> RemoveWorker(job::WorkerId worker);
  /// Renews the worker's leases that are in `held` and have progressed within SchedulerOptions::stall, and
  /// voids those that are not in `held`, except leases with an attempt above `newest`, the last attempt that
  /// the worker had received when it sent the heartbeat.
  void Heartbeat(job::WorkerId worker, absl::Span<const HeldLease> held, job::Attempt newest, absl::Time now);
  /// Voids leases whose deadline is not after `now`, makes overdue units ready for a second lease, ends
  /// backoffs and readmits workers that were set aside. A silent worker gets no new leases until its next
  /// heartbeat; a stalled lease keeps its slot until a heartbeat no longer names it.
  std::vector<LateLease> ExpireLeases(absl::Time now);
  /// When ExpireLeases has something to do next; InfiniteFuture if nothing is due.
  absl::Time NextExpiry() const;

  /// Grants leases until all slots are full or no unit is free; the leases of a worker are consecutive.
  std::vector<GrantedLease> GrantLeases(absl::Time now);
  /// Grants leases to one worker; none of units in quarantine.
  std::vector<GrantedLease> GrantLeases(job::WorkerId worker, absl::Time now);
  bool HoldsLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) const;
  /// Records that a worker delivered a complete unit.
  Completion CompleteUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                          absl::Time now);
  /// Records that an accepted unit is committed. True when it was the last unit of its frame.
  bool UnitCommitted(const job::UnitRef& unit);
  /// Makes a committed unit free again, because its record was lost. False for a unit that is not committed, and
  /// for one of a finished frame.
  bool RevokeUnit(const job::UnitRef& unit);
  /// Records that a worker could not render a unit. A permanent failure, which every worker would have, ends
  /// the job when a second worker agrees, or at once if no other worker can be asked.
  FailureOutcome FailUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                          bool permanent, absl::Time now);
  /// Workers that were set aside since the last call.
  std::vector<SetAsideWorker> TakeSetAside();
  /// Why the worker is set aside; empty if it is not.
  std::string SetAsideReason(job::WorkerId worker) const;

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
  // Times of accepted units, from lease to delivery.
  struct UnitTimes {
    int64_t count = 0;
    absl::Duration sum;
  };
  // A unit that was leased in vain; forgotten once it is accepted.
  struct History {
    int failures = 0;
    job::WorkerId last_failed;
    std::set<job::WorkerId> failed_workers;
    std::set<std::string> permanent_by;  // names of workers that called the failure permanent
    int losses = 0;
    std::set<std::string> lost_workers;  // by name
  };
  // A worker that is reserved for a unit in quarantine.
  struct Reservation {
    UnitIndex unit;
    bool granted = false;  // otherwise the worker still has other leases
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
    std::set<Place> returned;  // leased once, and free again or overdue
    UnitTimes geometry_times;
    UnitTimes pass_times;
    std::map<Place, History> history;
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
  void VoidOtherLeases(const UnitIndex& index);
  UnitTimes& TimesOf(Job& job, const Place& place) const;
  void CountTime(const Lease& lease, absl::Time now);
  /// When a lease granted at `granted` is overdue; InfiniteFuture if too few units were accepted to tell.
  absl::Time OverdueTime(const UnitIndex& index, absl::Time granted);
  void Renew(job::Attempt attempt, int64_t progress, absl::Time now);
  /// Whether the unit, which is not accepted, may be leased: no lease of it is in time.
  bool MayReturn(const UnitIndex& index) const;
  void Return(const UnitIndex& index);
  void CountCommitted(Job& job, const Place& place);

  /// Ready jobs are those that may have free units. Enters the job among them, or removes it.
  void UpdateReady(int64_t number, const Job& job);
  void RemoveReady(int64_t number, const Job& job);
  bool HasReady(const std::string& numeric_class) const;
  /// The first ready job after `number` whose units workers of the class may lease.
  std::optional<int64_t> NextReady(const std::string& numeric_class, int64_t number) const;

  void GrantTo(job::WorkerId worker, absl::Time now, std::vector<GrantedLease>* granted);
  std::optional<Place> TakeUnit(int64_t job_number, job::WorkerId worker, SkipBudget* budget);
  std::optional<Place> TakeReturnedUnit(int64_t job_number, job::WorkerId worker, SkipBudget* budget);
  std::optional<Place> TakeUnleasedUnit(Job& job);
  bool IsExcluded(const Job& job, const UnitIndex& index, job::WorkerId worker) const;
  GrantedLease Grant(const UnitIndex& index, job::WorkerId worker, absl::Time now, bool alone);
  void VoidLease(job::Attempt attempt);
  void ReleaseSlot(job::WorkerId worker);

  // Failures, in blame.cc.
  /// Returns the failed unit, which has no lease in time, after its backoff.
  void ReturnAfter(const UnitIndex& index, absl::Duration backoff, absl::Time now);
  void ReturnDelayed(absl::Time now);
  /// The unit is accepted: blames the other workers that failed it.
  void BlameOthers(const UnitIndex& index, job::WorkerId worker, absl::Time now);
  void Blame(job::WorkerId worker, int64_t job, absl::Time now);
  void Readmit(absl::Time now);

  // Quarantine, in quarantine.cc.
  /// Counts the loss of a worker with a unit. Returns the job's error if the unit was in quarantine.
  std::string CountLoss(const Lease& lease);
  bool IsSuspect(const UnitIndex& index) const;
  /// Reserves workers for units in quarantine, and leases the units to those that have become idle.
  void GrantQuarantined(absl::Time now, std::vector<GrantedLease>* granted);
  std::optional<job::WorkerId> FindWorkerFor(const UnitIndex& index) const;
  std::optional<job::WorkerId> FindWorkerFor(const UnitIndex& index, const std::string& numeric_class) const;
  /// Ends a reservation that is not granted; the unit goes back to the quarantine.
  void CancelReservation(job::WorkerId worker);
  void RemoveFromQuarantine(const UnitIndex& index);

  const SchedulerOptions options_;
  int64_t next_attempt_;
  int64_t next_job_ = 0;
  std::map<int64_t, Job> jobs_;  // by order of arrival
  std::map<job::JobId, int64_t> jobs_by_id_;
  std::map<std::string, std::set<int64_t>> ready_;  // jobs by numeric class, "" for any; never empty
  WorkerPool workers_;
  LeaseTable leases_;
  std::set<std::pair<job::WorkerId, job::Attempt>> stalled_;  // void, but still in a slot of the worker
  std::map<UnitIndex, job::WorkerId> accepted_;
  std::set<std::pair<absl::Time, UnitIndex>> delayed_;  // units that may return; some are accepted by then
  std::vector<SetAsideWorker> newly_set_aside_;
  std::set<UnitIndex> quarantine_;  // units that wait for a reservation
  std::map<job::WorkerId, Reservation> reservations_;
};

}  // namespace lumifold::scheduler
