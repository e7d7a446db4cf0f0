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

namespace lumifold::scheduler {

struct SchedulerOptions {
  /// How long a lease lasts after it is granted or renewed.
  absl::Duration lease = absl::Seconds(30);
  /// So many failures of one unit fail its job.
  int max_failures = 3;
  /// Attempt number of the first lease. A restarted coordinator must begin above all it gave before.
  Attempt first_attempt{1};
};

/// One lease as it is handed out.
struct GrantedLease {
  UnitRef unit;
  Attempt attempt;
  Rect rect;
  SampleRange samples;
};

/// A lease that was taken back because its time ran out.
struct ExpiredLease {
  UnitRef unit;
  WorkerId worker;
};

/// What becomes of a delivered unit.
enum class Completion {
  kAccepted,   // the lease was good: the caller stores the unit and then calls UnitMerged
  kDuplicate,  // the unit has been accepted before
  kStale,      // the lease is void or another worker's
  kUnknown,    // no such unit, or its job has ended
};

/// What becomes of a unit that a worker could not render.
enum class FailureOutcome {
  kRetried,   // somebody gets it again
  kJobFails,  // too many failures, or a permanent one: the caller ends the job
  kIgnored,   // the lease was void anyway
};

/// Where an active job stands.
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

/// Who renders what. Pure state and policy: no clock, no thread, no disk. Everything is a function of the
/// calls so far, so that a test can replay any history. Active jobs only: an ended job is forgotten.
///
/// A unit is free, leased, accepted (delivered, not yet durable) or merged. Only a free unit is leased, only
/// a leased one accepted, only an accepted one merged, and neither of the last two ever becomes free again:
/// that is the exactly-once promise.
///
/// Order: jobs as they were added; frames by number; within a frame as FrameUnits numbers its units. A unit
/// that came back goes first, but not to the worker that just failed it while there is another one of its
/// class. A job's units go to workers of one numeric class, that of its first lease.
///
/// Memory: one bit a unit of the frames in work, plus the leases.
/// Threads: one at a time.
class Scheduler {
 public:
  explicit Scheduler(const SchedulerOptions& options);

  /// Adds a job whose spec is normalised and whose id is new. `numeric_class` is empty unless the job was
  /// bound before a restart.
  void AddJob(const JobId& job, const v1::JobSpec& spec, const std::string& numeric_class = "");
  /// Tells of a unit that was merged before a restart. Before any lease of the job. False for a unit the job
  /// does not have.
  bool RestoreMergedUnit(const UnitRef& unit);
  /// Tells of a frame whose result was written before a restart. Before any lease of the job.
  bool RestoreFinishedFrame(const JobId& job, int32_t frame);
  /// Forgets the job; its leases are void.
  void EndJob(const JobId& job);
  bool HasJob(const JobId& job) const { return jobs_by_id_.contains(job); }

  /// Adds a worker whose id is new; `slots` >= 1 is how many units it may hold, unmerged ones included.
  void AddWorker(WorkerId worker, const std::string& numeric_class, int slots);
  /// The worker is gone: its leases are void at once.
  void RemoveWorker(WorkerId worker);
  /// Renews the leases named in `held` and voids those not named, save those newer than `newest`, the last
  /// attempt the worker had seen: the heartbeat may have crossed them on its way.
  void Heartbeat(WorkerId worker, absl::Span<const std::pair<UnitRef, Attempt>> held, Attempt newest,
                 absl::Time now);
  /// Voids leases whose deadline is not after `now`. A worker that let one run out gets no other until it is
  /// heard of again.
  std::vector<ExpiredLease> ExpireLeases(absl::Time now);
  /// When the next lease runs out; InfiniteFuture without leases.
  absl::Time NextExpiry() const;

  /// Fills the worker's free slots.
  std::vector<GrantedLease> GrantLeases(WorkerId worker, absl::Time now);
  bool HoldsLease(WorkerId worker, const UnitRef& unit, Attempt attempt) const;
  /// A worker has delivered a unit whole.
  Completion CompleteUnit(WorkerId worker, const UnitRef& unit, Attempt attempt);
  /// An accepted unit is durable. True when it was the last one of its frame.
  bool UnitMerged(const UnitRef& unit);
  FailureOutcome FailUnit(WorkerId worker, const UnitRef& unit, Attempt attempt, bool permanent);

  /// Frames of the job that are merged whole and not finished.
  std::vector<int32_t> MergedFrames(const JobId& job) const;
  /// A merged frame's result is written. True when it was the last one of the job.
  bool FrameFinished(const JobId& job, int32_t frame);

  /// The job must be known.
  JobProgress Progress(const JobId& job) const;
  /// The class the job is bound to; empty before its first lease. The job must be known.
  const std::string& NumericClassOf(const JobId& job) const;
  const v1::JobSpec& SpecOf(const JobId& job) const;
  const FrameUnits& UnitsOf(const JobId& job) const;

 private:
  // A unit within its job: which frame, counted from 0, and its number in it.
  struct Place {
    int frame = 0;
    int64_t number = 0;
    friend auto operator<=>(const Place&, const Place&) = default;
  };
  struct Frame {
    std::vector<bool> taken;  // accepted or merged, by unit number
    int64_t merged = 0;
  };
  struct Failures {
    int count = 0;
    WorkerId last;
  };
  struct Job {
    JobId id;
    v1::JobSpec spec;
    FrameUnits units;
    std::string numeric_class;
    std::map<int, Frame> frames;  // those in work
    std::vector<bool> finished;   // by frame
    int finished_count = 0;
    int64_t merged_units = 0;
    int64_t merged_samples = 0;
    Place fresh;               // where units that were never leased begin
    std::set<Place> returned;  // leased once, free again
    std::map<Place, Failures> failures;
  };
  struct LeaseKey {
    int64_t job = 0;  // as jobs_ counts them
    Place place;
    friend auto operator<=>(const LeaseKey&, const LeaseKey&) = default;
  };
  struct Lease {
    WorkerId worker;
    Attempt attempt;
    absl::Time deadline;
  };
  struct Worker {
    std::string numeric_class;
    int slots = 1;
    int busy = 0;         // leases and accepted units
    bool silent = false;  // let a lease run out and has not been heard of since
  };

  Job* FindJob(const JobId& id);
  const Job& GetJob(const JobId& id) const;
  std::optional<LeaseKey> KeyOf(const UnitRef& unit) const;
  Frame& FrameInWork(Job& job, int frame);
  std::optional<Place> TakeReturnedUnit(Job& job, WorkerId worker);
  std::optional<Place> TakeFreshUnit(Job& job);
  bool HasRival(WorkerId worker) const;
  GrantedLease Grant(int64_t job_number, Job& job, const Place& place, WorkerId worker, absl::Time now);
  std::map<LeaseKey, Lease>::iterator VoidLease(std::map<LeaseKey, Lease>::iterator lease);
  void ReleaseSlot(WorkerId worker);
  UnitRef RefOf(const LeaseKey& key) const;
  void CountMerged(Job& job, const Place& place);

  const SchedulerOptions options_;
  int64_t next_attempt_;
  int64_t next_job_ = 0;
  std::map<int64_t, Job> jobs_;  // by order of arrival
  std::map<JobId, int64_t> jobs_by_id_;
  std::map<WorkerId, Worker> workers_;
  std::map<LeaseKey, Lease> leases_;
  std::map<LeaseKey, WorkerId> accepted_;
};

}  // namespace lumifold::scheduler
