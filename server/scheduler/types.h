#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "filter/image/rect.h"
#include "filter/image/tile_samples.h"
#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/job.pb.h"
#include "proto/retry/pauses.h"
#include "server/job/ids.h"
#include "server/job/unit.h"
#include "server/scheduler/fair_share.h"

/// What goes into the scheduler and comes out of it.
namespace lumifold::scheduler {

/// When a unit that fails again and again fails its job, see Disputes.
struct DisputeOptions {
  /// A party that has failed a unit this many times calls it impossible.
  int max_failures = 3;
  /// A unit with which this many parties were lost, or twice as many times any, is in quarantine: it is
  /// leased once more, to a worker that then renders nothing else. If that is lost too, all these parties
  /// call the unit impossible.
  int max_lost_workers = 3;
  /// Parties, or witnesses among them, that fail a job if they call one of its units impossible.
  int deciding_parties = 3;
  int deciding_witnesses = 2;
  /// How long others are waited for who might render a unit that was called impossible.
  absl::Duration patience = absl::Minutes(1);
};

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
  DisputeOptions disputes{};
  /// How long a failed unit waits before it is leased again, by the number of its failures.
  retry::Pauses backoff = {.first = absl::Seconds(1), .longest = absl::Seconds(60)};
  /// A worker that failed units of this many jobs within `cool_down`, each rendered by another worker since,
  /// gets no leases for `cool_down`.
  int max_attributed_jobs = 2;
  absl::Duration cool_down = absl::Minutes(5);
  /// A worker goes on with the job it rendered last, whose scene it has loaded, while its user and priority
  /// are ahead of their shares by no more than this, and none of their other jobs comes first.
  FairShare::Tolerance locality{};
  /// The first ready job of a user and priority that have waited this long gets every eighth lease, whatever
  /// its share.
  absl::Duration longest_wait = absl::Minutes(10);
  /// A unit is late when it has been leased for longer than `late_factor` times the mean of its job and kind,
  /// or at once if its worker is slow. Late units are leased a second time to idle slots that are expected to
  /// end earlier.
  double late_factor = 1.5;
  /// An audit for which no other worker has been available for this long is waived.
  absl::Duration audit_patience = absl::Seconds(30);
  /// Bytes of accepted units beyond which a worker's slot stays taken until its unit is committed.
  uint64_t uncommitted_bytes = uint64_t{256} << 20;
  /// Attempt of the first lease. After a restart it must be above all attempts granted before.
  job::Attempt first_attempt{1};
};

/// How a job is scheduled; nothing here changes the picture. v1::Scheduling documents the fields.
struct JobOptions {
  int priority = 0;
  /// Jobs of one user and priority get units in the order of their turns, then in that of their arrival.
  int64_t turn = 0;
  std::string user{};
  std::vector<std::string> tags{};  // in any order
  int max_leases = 0;               // 0: no limit
  /// Only workers of this class render the job. Empty: the class of its first accepted unit.
  std::string numeric_class{};
  bool paused = false;
  double audit_share = 0;
};

/// Whether a unit is among the `share` of the units of its job that are audited: a hash of job and unit
/// decides. A plan unit never is.
bool IsAudited(const job::UnitRef& unit, double share);

/// The fields of `scheduling` that concern the scheduler.
JobOptions OptionsOf(const v1::Scheduling& scheduling);

/// What a worker offers to keep, see Keeping.
struct KeepOffer {
  int frames = 0;
  /// Memory for their records.
  uint64_t record_bytes = 0;
  /// Memory in which it makes the result of one.
  uint64_t finish_bytes = 0;
};

/// What a frame of a job takes of it. Without bytes the job's frames are not kept.
struct KeepDemand {
  uint64_t record_bytes = 0;
  uint64_t finish_bytes = 0;
  /// While fewer frames than this are in flight, of all jobs, the next one is not kept.
  int least_in_flight = 0;
};

/// What a worker says of itself when it connects.
struct WorkerTraits {
  /// Whom losses and failures count against, over all its connections. Empty: the worker's id.
  std::string name{};
  /// Workers of one party may err together: their word counts once. Empty: the name.
  std::string party{};
  std::string numeric_class{};
  /// The same while the process lives, over all its connections, and of no other process; 0: not known.
  uint64_t instance = 0;
  /// How many units it holds at a time, see LeaseAhead and AcceptedUnits. 0: it renders none.
  int slots = 1;
  /// 0: not known, and then enough for any job.
  uint64_t memory_bytes = 0;
  std::vector<std::string> tags{};  // in any order
  KeepOffer keep{};
};

/// Why a unit that had a lease became free again.
enum class RetryReason {
  kWorkerLost,     // its worker has disconnected
  kWorkerBlocked,  // its worker was blocked
  kExpired,        // its worker has not renewed the lease
  kStalled,        // the lease was renewed, but made no progress
  kDropped,        // its worker no longer names the lease in its heartbeats
  kOverdue,        // the lease stays valid, but takes much longer than others
  kHandedBack,     // its worker will not deliver it
  kFailed,         // its worker could not render it, or delivered what is not valid
  kOtherClass,     // the job was given another numeric class than that of its worker
  kTakenBack,      // it was committed, and its pixels are lost or wrong
};

/// Counts of units and workers.
struct Metrics {
  int64_t units_queued = 0;    // neither leased, accepted nor committed, of jobs that are not paused
  int64_t units_leased = 0;    // once or twice; audits do not count
  int64_t slots = 0;           // of all workers
  int64_t leases_expired = 0;  // not renewed, or stalled; since the start, as `retries`
  std::map<RetryReason, int64_t> retries;
  std::map<v1::WorkerState, int64_t> workers;
};

/// A new lease.
struct GrantedLease {
  job::WorkerId worker;
  job::UnitRef unit;
  job::Attempt attempt;
  Rect rect;
  TileSamples samples;
  /// The unit is in quarantine.
  bool alone = false;
  /// The unit is already accepted: the result is only compared.
  bool audit = false;
  /// Its worker keeps the frame.
  bool keep = false;
};

/// A job that cannot go on, see Disputes; the caller ends it with this error.
struct FailedJob {
  job::JobId job;
  std::string error;
  /// Of the unit; nullopt for a plan unit.
  std::optional<int32_t> frame;
};

/// What a worker says of a unit that it could not render.
struct UnitFailure {
  bool permanent = false;      // every worker would have it
  bool out_of_memory = false;  // the worker is too small, which says nothing against the job
  std::string error{};         // one line
};

/// What a delivered unit took.
struct UnitCost {
  absl::Duration rendering{};
  uint64_t bytes = 0;
};

/// A lease as its worker reports it in a heartbeat.
struct HeldLease {
  job::UnitRef unit;
  job::Attempt attempt;
  /// Differs from the last report if the unit has advanced.
  int64_t progress = 0;
};

/// A worker that gets no leases for a while, because it fails units that other workers render.
struct CoolingWorker {
  job::WorkerId worker;
  absl::Time until;
  std::string reason;
};

/// A lease that ended although its worker did not say so: the worker may still render the unit.
struct RevokedLease {
  job::WorkerId worker;
  job::UnitRef unit;
  job::Attempt attempt;
};

/// A committed unit of an unfinished frame, as a restart finds it.
struct RestoredUnit {
  job::UnitKey key;
  std::string worker{};  // name of the worker that delivered it; empty if that is not known
  std::string digest{};  // of an audited unit, as for Units::Complete; empty if it is not known
};

/// A worker that delivered other pixels than two others did; it is blocked from now on.
struct FaultyWorker {
  std::string name;
  /// Empty if the worker was reported before, and these are further units of it.
  std::string reason;
  /// Committed units that it delivered, of frames that are not finished. The caller discards them and then
  /// calls Units::Revoke for each; until then their frames are not committed.
  std::vector<job::UnitRef> units;
};

/// A worker that gets no leases until an operator readmits it, connected or not.
struct BlockedWorker {
  std::string name;
  std::string reason;
};

/// A connected worker, for lists.
struct WorkerInfo {
  job::WorkerId worker{};
  WorkerTraits traits{};
  v1::WorkerState state = v1::WORKER_STATE_IDLE;
  std::string reason{};  // why it cools down or is blocked
  int leases = 0;
  int64_t units_done = 0;  // accepted
  int64_t units_failed = 0;
  absl::Duration mean_time{};      // of its accepted units, from lease to delivery
  std::vector<job::JobId> jobs{};  // of its leases, each once
};

/// A reason why a job is not running, or is slow.
struct Reason {
  std::string code;  // such as "no_worker"; Scheduler::Explain lists them
  std::string text;  // one line, with names and numbers
};

enum class Lateness {
  kSilent,   // the worker has not renewed the lease, which is revoked
  kStalled,  // the worker renews the lease but makes no progress; the lease is revoked
  kDropped,  // the worker no longer names the lease in its heartbeats; the lease is revoked
  kOverdue,  // the lease stays valid; the unit is leased a second time, and the first result counts
};

struct LateLease {
  job::UnitRef unit;
  job::WorkerId worker;
  Lateness lateness = Lateness::kSilent;
};

/// Outcome of the delivery of a unit.
enum class Completion {
  kAccepted,   // the lease was valid: the caller commits the unit and then calls Units::Commit
  kAudited,    // a second result of an audited unit: it is compared, and the caller drops it
  kDuplicate,  // the unit is already accepted or committed
  kStale,      // the lease has ended or belongs to another worker
  kUnknown,    // no such unit, or the job has ended
};

/// Progress of an active job.
struct JobProgress {
  v1::JobState state = v1::JOB_STATE_PLANNED;
  int64_t units_done = 0;
  int64_t units_total = 0;
  int64_t samples_done = 0;
  int64_t samples_total = 0;
  int frames_done = 0;
  int frames_skipped = 0;  // samples_total and units_total do not have theirs
  int frames_total = 0;
  int workers = 0;
  int64_t leases = 0;
  int64_t audits_settled = 0;  // audited units of which two workers delivered the same pixels
  int64_t audits_waived = 0;   // audited units for which not enough workers were available
};

}  // namespace lumifold::scheduler
