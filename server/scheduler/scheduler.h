#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include "lumifold/v1/job.pb.h"
#include "server/job/frame_list.h"
#include "server/job/frame_rounds.h"
#include "server/job/plan.h"
#include "server/job/tile_grid.h"
#include "server/job/unit.h"
#include "server/scheduler/fair_share.h"
#include "server/scheduler/lease_table.h"
#include "server/scheduler/name_table.h"
#include "server/scheduler/types.h"
#include "server/scheduler/worker_pool.h"

namespace lumifold::scheduler {

/// Assigns units to workers. Pure state and policy: no clock, no threads, no disk. The state is a function of
/// the calls so far, so that a test can replay any history. Holds active jobs only.
///
/// A unit is free, leased, accepted (delivered, not yet committed) or committed. Only a free, late or overdue
/// unit is leased, or one that the worker has in hand (see Regrant); only a leased unit is accepted, only an
/// accepted unit is committed; accepted and committed units never become free again unless RevokeUnit says
/// so. This is the exactly-once promise. A unit has up to two leases, of different workers; the other one
/// becomes void when the unit is accepted.
///
/// Plan: a job that needs one (server/job/plan.h) has one unit, its plan unit, until SetPlan divides it into
/// the units of its frames. Loss, failure and quarantine hold for it as for any unit; it is not audited.
///
/// Numeric class: all units of a job are of one class, that of its first accepted unit unless its options
/// name one. Until then workers of all classes may lease its units; then the leases of the other classes
/// become void. Tags: only workers that have all tags of a job lease its units.
///
/// Order: users and jobs by fair share (fair_share.h), except that a worker goes on with the job whose scene
/// it has loaded while that job is not far ahead of its share, and that no ready job waits for ever; frames
/// in the order of the job's frame list; within a frame as FrameUnits numbers its units. A unit whose lease
/// became void is granted before units that were never leased, but not to the worker that failed it last
/// while another worker that may render the job is available. Where several workers are free, the one that
/// was added first gets the unit. Where slots are idle, late units are leased to a second worker.
///
/// Frames in flight: a frame is active from the first lease or committed unit until its result is written.
/// Frames count against SetMaxActiveFrames while their job is not paused and a worker that may render it is
/// available: all of these can be finished, so that the limit cannot stop the farm.
///
/// Audits: a share of the units of a job, chosen by a hash of job and unit, is leased again to a worker of
/// another name once it is accepted. Equal digests settle the audit; otherwise further workers decide by
/// majority, and a worker in the minority is blocked, and its units of frames that are not finished are
/// revoked. A frame counts as committed when its audits are settled or waived too. A restart begins the
/// audits of unfinished frames again.
///
/// Time: O(log n) for each unit, lease and worker that a call names, returns or changes; n counts jobs,
/// leases and workers. A grant also looks at each distinct pair of class and tags that ready jobs require.
/// A verdict about a faulty worker looks at each unit of the active frames.
/// Memory: 33 bits for each unit of the active frames, plus leases and audits.
/// Threads: one at a time.
class Scheduler {
 public:
  explicit Scheduler(const SchedulerOptions& options);

  /// Adds a job with a normalised spec and a new id. After a restart `options.numeric_class` is the class
  /// that the job is bound to.
  void AddJob(const job::JobId& job, const v1::JobSpec& spec, const JobOptions& options = {});
  /// Restores a unit that was committed before a restart. Call it before any lease of the job. False for a
  /// unit that the job does not have.
  bool RestoreCommittedUnit(const job::JobId& job, const RestoredUnit& unit, absl::Time now);
  /// Restores a frame whose result was written before a restart. Call it before any lease of the job and
  /// before the committed units of the frame. False for a frame that the job does not have.
  bool RestoreFinishedFrame(const job::JobId& job, int32_t frame);
  /// A paused job gets no new leases; the units that it has are still accepted. These three have no effect on
  /// an unknown job.
  void PauseJob(const job::JobId& job);
  void ResumeJob(const job::JobId& job);
  void SetPriority(const job::JobId& job, int priority);
  /// Units of a further frame are leased only while fewer frames than this are active; >= 1. No limit before
  /// the first call.
  void SetMaxActiveFrames(int frames);
  /// Sets the rounds of a frame with adaptive sampling that are decided now; those before stay as they were.
  /// Before the first call for a frame it has those of FrameRounds(spec). After a restart call it before
  /// RestoreCommittedUnit for units of the frame. No effect on an unknown job or a finished frame. True when
  /// the frame is committed by this, see IsFrameCommitted.
  bool SetRounds(const job::JobId& job, int32_t frame, std::shared_ptr<const job::FrameRounds> rounds);
  /// The rounds of a frame that is active; null for others, and without adaptive sampling.
  std::shared_ptr<const job::FrameRounds> RoundsOf(const job::JobId& job, int32_t frame) const;
  /// How many rounds from the first on are committed, with the geometry; 0 where RoundsOf is null.
  int CommittedRounds(const job::JobId& job, int32_t frame) const;
  /// Sample indices of a unit that is leased or accepted.
  TileSamples SamplesOf(const job::UnitRef& unit) const;
  /// Removes the job; its leases become void.
  void EndJob(const job::JobId& job);
  bool HasJob(const job::JobId& job) const { return jobs_by_id_.contains(job); }

  /// Adds a worker with a new id. Leases of an earlier connection of the same process become void, which
  /// counts as no loss: its end has not been noticed yet, and it gets no more.
  void AddWorker(job::WorkerId worker, const WorkerTraits& traits);
  /// Removes a worker; its leases become void at once, and each counts as a loss of the worker with the unit.
  std::vector<FailedJob> RemoveWorker(job::WorkerId worker);
  /// Grants the worker no more leases; it finishes those it has.
  void DrainWorker(job::WorkerId worker);
  /// Voids the leases of the workers with this name and grants them none until ReadmitWorker, those that
  /// connect later included.
  void BlockWorker(const std::string& name, const std::string& reason);
  /// Ends a block or a drain, or the time for which the worker was set aside. False if no worker has this
  /// name.
  bool ReadmitWorker(const std::string& name);
  /// The worker will not deliver the unit: it is free at once. This is neither a failure nor a loss. False if
  /// the worker does not hold the lease.
  bool HandBack(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt);
  /// Renews the worker's leases that are in `held` and have progressed within SchedulerOptions::stall, and
  /// voids those that are not in `held`, except leases with an attempt above `newest`, the last attempt that
  /// the worker had received when it sent the heartbeat. Returns the voided ones: each counts as a loss of
  /// the worker with the unit, which another worker gets next if there is one.
  std::vector<LateLease> Heartbeat(job::WorkerId worker, absl::Span<const HeldLease> held,
                                   job::Attempt newest, absl::Time now);
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
  /// Grants the worker leases of units that it has rendered or is rendering for leases of an earlier
  /// connection: of those that it may still lease, in this order, while it has free slots. A unit that one
  /// other worker has leased meanwhile gets a second lease, since it costs no rendering; the first result
  /// counts.
  std::vector<GrantedLease> Regrant(job::WorkerId worker, absl::Span<const job::UnitRef> units,
                                    absl::Time now);
  /// Whether the unit is accepted or committed.
  bool HasResult(const job::UnitRef& unit) const;
  bool HoldsLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) const;
  /// Records that a worker delivered a complete unit. `digest` is equal for equal pixels, and empty only
  /// where no job is audited.
  Completion CompleteUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                          absl::Time now, absl::string_view digest = "");
  /// Records that an accepted unit is committed. True when its frame is committed now.
  bool UnitCommitted(const job::UnitRef& unit);
  /// Records that the accepted plan unit of a job is committed: the job now has this spec, and the units of
  /// its frames. No effect if the job has ended.
  void SetPlan(const job::UnitRef& unit, const v1::JobSpec& planned);
  /// Makes a committed unit free again, because its record was lost. False for a unit that is not committed,
  /// and for one of a finished frame.
  bool RevokeUnit(const job::UnitRef& unit);
  /// Records that a worker could not render a unit. A permanent failure, which every worker would have, ends
  /// the job when a second worker agrees, or at once if no other worker can be asked.
  FailureOutcome FailUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                          bool permanent, absl::Time now);
  /// Workers that were set aside since the last call.
  std::vector<SetAsideWorker> TakeSetAside();
  /// Why the worker is set aside; empty if it is not.
  std::string SetAsideReason(job::WorkerId worker) const;

  /// Leases that became void since the last call although their workers did not say so. A caller that tells
  /// the workers, before it sends them new leases, ends work that is in vain.
  std::vector<VoidedLease> TakeVoided();

  /// Workers found faulty since the last call.
  std::vector<FaultyWorker> TakeFaulty();
  /// Frames that became committed since the last call because their last audit was settled or waived;
  /// UnitCommitted has not reported them.
  std::vector<std::pair<job::JobId, int32_t>> TakeSettledFrames();

  /// Frames of the job whose units are all committed and audited and whose result is not written.
  std::vector<int32_t> CommittedFrames(const job::JobId& job) const;
  /// False also for a frame of which units were revoked since it was committed.
  bool IsFrameCommitted(const job::JobId& job, int32_t frame) const;
  /// Records that the result of a frame is written. True when it was the last frame of the job. No effect on
  /// a frame of which units are not committed and audited. Units that were to be revoked stay: their pixels
  /// are in the result.
  bool FrameFinished(const job::JobId& job, int32_t frame);

  /// Why the job does not run, or runs slowly, most important first; empty for a job that runs as it should,
  /// has all its units committed, or is unknown. Linear in the jobs and in the leases of the job. Codes:
  /// paused, no_worker, worker_unavailable, slots_busy, max_leases, frames_in_flight, backoff, quarantine,
  /// worker_set_aside, overdue, audit, filtering.
  std::vector<Reason> Explain(const job::JobId& job, absl::Time now) const;
  /// nullopt for a worker that is not connected.
  std::optional<WorkerInfo> DescribeWorker(job::WorkerId worker) const;
  /// At most `limit` connected workers with ids above `after`, ascending.
  std::vector<WorkerInfo> Workers(job::WorkerId after, int limit) const;
  /// Connected workers with this name.
  std::vector<job::WorkerId> WorkersNamed(const std::string& name) const { return workers_.Named(name); }
  /// By name.
  std::vector<BlockedWorker> Blocked() const;
  /// Counts of units and workers. Linear in jobs, workers and accepted units.
  Figures CountAll() const;
  /// Frames that count against SetMaxActiveFrames.
  int active_frames() const;
  /// Frames from their first lease until FrameFinished, of all jobs.
  int64_t frames_in_flight() const;
  int64_t lease_count() const { return leases_.size(); }

  /// The job must be known.
  JobProgress Progress(const job::JobId& job) const;
  /// The class the job is bound to; empty before its first accepted unit. The job must be known.
  const std::string& NumericClassOf(const job::JobId& job) const;
  const v1::JobSpec& SpecOf(const job::JobId& job) const;
  const job::FrameUnits& UnitsOf(const job::JobId& job) const;

 private:
  struct Frame {
    std::vector<bool> taken;                         // accepted or committed, by unit number
    std::shared_ptr<const job::FrameRounds> rounds;  // null without adaptive sampling
    std::vector<int64_t>
        left;  // with rounds: units that are not committed, of the geometry and of each round
    std::vector<uint32_t> deliverers;  // numbers of the workers' names, 0 for none; by unit number
    int64_t committed = 0;
    int64_t audits = 0;          // not settled
    std::set<int64_t> revoking;  // units of faulty workers that the caller has not revoked yet
  };
  // Times of accepted units of one size, from lease to delivery.
  struct UnitTimes {
    int64_t count = 0;
    absl::Duration sum;
  };
  // A unit that was leased in vain; forgotten once it is accepted.
  struct History {
    int failures = 0;
    std::string last_failed;  // name of the last worker that failed or dropped it; it may reconnect
    std::set<job::WorkerId> failed_workers;
    std::set<std::string> permanent_by;       // names of workers that called the failure permanent
    std::multiset<std::string> lost_workers;  // by name, once for each loss
  };
  struct Vote {
    std::string worker;  // name
    std::string digest;
  };
  // An accepted unit that further workers render.
  struct Audit {
    std::vector<Vote> votes;         // the first is that of the accepted result
    std::set<std::string> declined;  // workers that could not render the unit
    absl::Time deadline;             // when it may be waived
    bool leased = false;
  };
  struct Taken {
    Place place;
    bool audit = false;
  };
  // A worker that is reserved for a unit in quarantine.
  struct Reservation {
    UnitIndex unit;
    bool granted = false;  // otherwise the worker still has other leases
  };
  enum class Readiness {
    kNone,        // no free unit, or none that may be leased now
    kUnit,        // a free unit of an active frame
    kOpensFrame,  // free units of frames that are not active only
  };
  // The jobs that need the same workers.
  struct Demand {
    int jobs = 0;
    int active_frames = 0;  // of jobs that are not paused
    FairShare::Queue with_unit;
    FairShare::Queue opening_frame;
    std::set<std::pair<absl::Time, job::Attempt>> late;  // leases, by their expected ends
  };
  using Demands = std::map<Requirement, Demand>;
  struct Job {
    Job(const job::JobId& job_id, const v1::JobSpec& job_spec)
        : id(job_id),
          spec(job_spec),
          units(job_spec),
          frame_list(job::NeedsPlan(job_spec) ? job::FirstFrameOf(job_spec) : job_spec),
          finished(static_cast<size_t>(frame_list.count())) {
      if (spec.has_adaptive() && !job::NeedsPlan(spec))
        first_rounds = std::make_shared<const job::FrameRounds>(spec);
    }

    /// Units of a frame that are leased in the order of their numbers. Those of later rounds become free one
    /// by one.
    int64_t ordered_units() const {
      return first_rounds == nullptr ? units.count()
                                     : int64_t{units.tiles().count()} * (1 + first_rounds->count());
    }

    job::JobId id;
    v1::JobSpec spec;
    job::FrameUnits units;
    job::FrameList frame_list;                             // the first one only until it is planned
    std::shared_ptr<const job::FrameRounds> first_rounds;  // of every frame; null without adaptive sampling
    int64_t later_units = 0;                               // of rounds that were decided later, in all frames
    Demands::iterator demand;
    Readiness readiness = Readiness::kNone;
    int max_leases = 0;  // 0: no limit
    bool paused = false;
    std::map<int, Frame> frames;     // active frames, by index
    std::set<int> committed_frames;  // active frames whose units are all committed
    std::vector<bool> finished;      // by frame
    int finished_count = 0;
    bool is_bound = false;  // a unit was accepted
    int64_t lease_count = 0;
    int64_t leased_units = 0;              // with one lease or two, not counting audits
    std::map<job::WorkerId, int> holders;  // number of leases; never 0
    std::map<Place, absl::Time> delayed;   // failed units, and the end of their backoff
    int64_t committed_units = 0;
    int64_t committed_samples = 0;
    Place
        next_unleased;  // units from here on, but for `ahead`, were never leased; it is not taken, see Advance
    std::set<Place> ahead;           // units after next_unleased that were leased by Regrant
    std::set<Place> returned;        // leased once, and free again or overdue
    std::array<UnitTimes, 3> times;  // of geometry units, of a short pass 0 and of other passes
    std::map<Place, History> history;
    double audit_share = 0;
    std::map<Place, Audit> audits;                 // not settled
    std::set<std::pair<int, Place>> audits_ready;  // those to lease, by number of votes
    int64_t audits_settled = 0;
    int64_t audits_waived = 0;
  };
  // A second lease is for a worker that hangs or is slow, or for a unit in hand; a third would only cost.
  static constexpr size_t kMaxLeasesOfUnit = 2;
  // What one call of GrantLeases may still look at in vain, see kMaxSkipped.
  using SkipBudget = int;

  Job* FindJob(const job::JobId& id);
  const Job& GetJob(const job::JobId& id) const;
  std::optional<UnitIndex> IndexOf(const job::UnitRef& unit) const;
  job::UnitRef RefOf(const UnitIndex& index) const;
  Frame& ActiveFrame(Job& job, int frame);
  static bool IsFrameComplete(const Job& job, const Frame& frame);
  static int64_t UnitsTotal(const Job& job);
  static TileSamples SamplesOf(const Job& job, const Place& place);
  static int64_t CameraSamplesOf(const Job& job, const Place& place);
  const Lease* FindLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) const;
  void Bind(int64_t job_number, const std::string& numeric_class);
  void VoidOtherLeases(const UnitIndex& index);
  static size_t SizeClassOf(const Job& job, const Place& place);
  static UnitTimes& TimesOf(Job& job, const Place& place);
  static const UnitTimes& TimesOf(const Job& job, const Place& place);
  void CountTime(const Lease& lease, absl::Time now);
  /// Sets when the lease is checked next, once the mean is known.
  void Schedule(job::Attempt attempt, Lease lease);
  /// Mean of the accepted units of the job and kind; nullopt if they are too few to tell.
  std::optional<absl::Duration> MeanTime(const UnitIndex& index) const;
  /// When a lease granted at `granted` is overdue; InfiniteFuture if the mean is not known. LateTime is never
  /// later.
  absl::Time OverdueTime(const UnitIndex& index, absl::Time granted) const;
  void Renew(job::Attempt attempt, int64_t progress, absl::Time now);
  LateLease Drop(job::Attempt attempt);
  /// Whether the unit, which is not accepted, may be leased: no lease of it is in time.
  bool MayReturn(const UnitIndex& index) const;
  void Return(const UnitIndex& index);
  void CountCommitted(Job& job, const Place& place);

  /// Removes a lease, without returning its unit.
  Lease RemoveLease(job::Attempt attempt);
  /// Moves job.next_unleased on to the first unit that is neither taken nor ahead, or the first frame that is
  /// not active.
  static void Advance(Job& job);
  const Requirement& RequirementOf(const Job& job) const { return job.demand->first; }
  /// Enters the job, which is not ready and has no active frames that count, among those of a requirement.
  void SetDemand(Job& job, const Requirement& requirement);
  void LeaveDemand(int64_t number, Job& job);
  /// Changes the number of active frames that count against the limit, see SetMaxActiveFrames.
  void CountFrames(const Job& job, int change);
  void RecountLiveFrames();

  static Readiness ReadinessOf(const Job& job);
  /// Enters the job among the ready ones, or removes it.
  void UpdateReady(int64_t number, Job& job);
  void SetReadiness(int64_t number, Job& job, Readiness readiness);
  bool MayOpenFrame() const { return live_frames_ < max_active_frames_; }
  bool HasReady(const Requirement& kind) const;
  /// The job whose unit the worker is to get next, except those in `passed`.
  std::optional<int64_t> NextReady(const Worker& worker, const std::set<int64_t>& passed, absl::Time now);

  // Late units, in speculation.cc.
  absl::Time LateTime(const UnitIndex& index, job::WorkerId worker, absl::Time granted) const;
  /// Relates the worker's time for a unit to the mean.
  void RateWorker(const Lease& lease, absl::Time now);
  void MarkLate(job::Attempt attempt, Lease lease, absl::Time now);
  bool HasLate(const Requirement& kind) const;
  /// Leases late units to workers that have idle slots.
  void Speculate(absl::Time now, std::vector<GrantedLease>* granted);
  std::optional<UnitIndex> TakeLateUnit(job::WorkerId worker, const Requirement& kind, absl::Time now);
  bool IsWorthASecondLease(const Lease& lease, job::WorkerId worker, absl::Time now) const;

  void GrantTo(job::WorkerId worker, absl::Time now, std::vector<GrantedLease>* granted);
  std::optional<Taken> TakeUnit(int64_t job_number, job::WorkerId worker, SkipBudget* budget);
  std::optional<Place> TakeReturnedUnit(int64_t job_number, job::WorkerId worker, SkipBudget* budget);
  std::optional<Place> TakeUnleasedUnit(int64_t job_number);
  /// Whether the worker may lease a unit that it has in hand; it is not free any more then.
  bool TakeInHand(const UnitIndex& index, job::WorkerId worker);
  bool IsExcluded(const Job& job, const UnitIndex& index, job::WorkerId worker) const;
  enum class LeaseKind { kOrdinary, kAlone, kAudit };
  GrantedLease Grant(const UnitIndex& index, job::WorkerId worker, absl::Time now, LeaseKind kind);
  /// Whether the unit may be leased again because of it.
  bool VoidLease(job::Attempt attempt);
  /// The same for a lease that the worker does not know to be void.
  bool RevokeLease(job::Attempt attempt);
  void ReleaseSlot(job::WorkerId worker);
  /// The unit, which is accepted, is committed: its worker has a free slot.
  void EndAccepted(const UnitIndex& index);

  // Workers, in workers.cc.
  WorkerInfo InfoOf(job::WorkerId id, const Worker& worker) const;
  /// Voids the leases of an earlier connection of the worker's process.
  void EndEarlierConnection(job::WorkerId worker, const WorkerTraits& traits);

  // Reasons, in explain.cc.
  void ExplainWorkers(int64_t number, std::vector<Reason>* reasons) const;
  /// "user ann has 12 leases, user ben 3", the users with the most ones.
  std::string BusiestUsers() const;
  void ExplainLimits(const Job& job, std::vector<Reason>* reasons) const;
  void ExplainUnits(int64_t number, absl::Time now, std::vector<Reason>* reasons) const;
  void ExplainOverdue(int64_t number, absl::Time now, std::vector<Reason>* reasons) const;

  // Audits, in audit.cc.
  void StartAudit(const UnitIndex& index, const std::string& worker, absl::string_view digest,
                  absl::Time now);
  std::optional<Place> TakeAudit(Job& job, job::WorkerId worker);
  /// The unit is not leased for its audit any more.
  void ReturnAudit(const UnitIndex& index);
  void DeclineAudit(const UnitIndex& index, job::WorkerId worker);
  void CompleteAudit(job::Attempt attempt, absl::string_view digest, absl::Time now);
  void DecideAudit(const UnitIndex& index, absl::Time now);
  void Convict(const std::string& worker, const std::string& reason);
  bool HasAuditor(const Job& job, const Audit& audit) const;
  void ExpireAudits(absl::Time now);
  /// Removes an audit, which is not leased.
  void EndAudit(const UnitIndex& index);
  void ReleaseDeliverers(const Frame& frame);
  /// Enters the frame among the committed ones, or removes it. True if it is one.
  bool UpdateCommitted(Job& job, int frame);

  // Failures, in blame.cc.
  /// Returns the failed unit, which has no lease in time, after its backoff.
  void ReturnAfter(const UnitIndex& index, absl::Duration backoff, absl::Time now);
  void ReturnDelayed(absl::Time now);
  /// The unit is accepted: blames the other workers that failed it.
  void BlameOthers(const UnitIndex& index, job::WorkerId worker, absl::Time now);
  void Blame(job::WorkerId worker, int64_t job, absl::Time now);
  void Readmit(absl::Time now);

  // Quarantine, in quarantine.cc.
  /// Counts the loss of a worker with a unit. Returns the job's error if the unit was in quarantine and the
  /// worker has said that it received the lease.
  std::string CountLoss(const Lease& lease);
  bool IsSuspect(const UnitIndex& index) const;
  /// The worker's process is here again: what it was lost with did not end it, and is no suspect because of
  /// it.
  void TakeBackLosses(job::WorkerId worker);
  /// The worker of the lease, which counted as lost with its unit, may come back.
  void NoteAbsence(const Lease& lease);
  /// Reserves workers for units in quarantine, and leases the units to those that have become idle.
  void GrantQuarantined(absl::Time now, std::vector<GrantedLease>* granted);
  std::optional<job::WorkerId> FindWorkerFor(const UnitIndex& index) const;
  std::optional<job::WorkerId> FindWorkerFor(const UnitIndex& index, int kind) const;
  /// Ends a reservation that is not granted; the unit goes back to the quarantine.
  void CancelReservation(job::WorkerId worker);
  void RemoveFromQuarantine(const UnitIndex& index);

  const SchedulerOptions options_;
  int64_t next_attempt_;
  int64_t next_job_ = 0;
  std::map<int64_t, Job> jobs_;  // by order of arrival
  std::map<job::JobId, int64_t> jobs_by_id_;
  FairShare share_;
  int64_t grants_ = 0;
  absl::Time latest_ = absl::InfinitePast();  // the latest time that a call has stated
  Demands demands_;
  int max_active_frames_ = std::numeric_limits<int>::max();
  int live_frames_ = 0;        // active frames that can be finished
  int64_t counted_kinds_ = 0;  // the pool's version at which they were counted
  WorkerPool workers_;
  LeaseTable leases_;
  std::map<std::string, std::string> blocked_;  // reasons, by the worker's name
  std::vector<VoidedLease> newly_voided_;
  int64_t leases_expired_ = 0;
  std::map<RetryReason, int64_t> retries_;
  std::set<std::pair<job::WorkerId, job::Attempt>> stalled_;  // void, but still in a slot of the worker
  std::map<UnitIndex, job::WorkerId> accepted_;
  std::set<std::pair<absl::Time, UnitIndex>> delayed_;  // units that may return; some are accepted by then
  std::vector<SetAsideWorker> newly_set_aside_;
  NameTable deliverers_;
  std::set<std::pair<absl::Time, UnitIndex>> audit_deadlines_;  // some of audits that have ended
  std::vector<FaultyWorker> newly_faulty_;
  std::vector<std::pair<job::JobId, int32_t>> newly_settled_;
  std::set<UnitIndex> quarantine_;  // units that wait for a reservation
  /// Units that processes were lost with which have not come back, by WorkerTraits::instance.
  std::map<uint64_t, std::vector<UnitIndex>> lost_with_;
  std::map<uint64_t, job::WorkerId> connections_;  // the last one of each process, by WorkerTraits::instance
  std::map<job::WorkerId, Reservation> reservations_;
};

}  // namespace lumifold::scheduler
