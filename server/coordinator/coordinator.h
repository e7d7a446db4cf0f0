#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/threads/event.h"
#include "proto/threads/task_thread.h"
#include "server/assets/asset_store.h"
#include "server/cluster/membership.h"
#include "server/commit/committer.h"
#include "server/coordinator/frame_limit.h"
#include "server/coordinator/options.h"
#include "server/finish/frame_finisher.h"
#include "server/job/dependencies.h"
#include "server/job/reopen_plan.h"
#include "server/ledger/job_store.h"
#include "server/metrics/farm_figures.h"
#include "server/metrics/farm_timings.h"
#include "server/metrics/traffic.h"
#include "server/scheduler/scheduler.h"
#include "server/storage/data_folder.h"
#include "server/storage/janitor.h"
#include "server/storage/storage_state.h"

namespace lumifold::access {
struct Identity;
}  // namespace lumifold::access

namespace lumifold::server {

/// What a worker has to deliver for a lease.
struct LeasedUnit {
  Rect rect;
  TileSamples samples;
  film::UnitModel model;
};

/// Queue of messages to a worker. Send never blocks and never calls back.
class WorkerSink {
 public:
  virtual ~WorkerSink() = default;
  virtual void Send(const v1::CoordinatorMessage& message) = 0;
};

/// Receives the status of a job. Its calls only queue: they never block and never call back.
class JobWatcher {
 public:
  virtual ~JobWatcher() = default;
  virtual void OnStatus(const v1::JobStatus& status) = 0;
  /// The job is no longer this coordinator's: nothing follows. kUnavailable where another one may know it.
  virtual void OnLost(const absl::Status& cause) = 0;
};

/// Makes all decisions of the coordinator: accepts jobs, grants leases, commits each unit once, finishes
/// frames, ends jobs. Independent of gRPC. Acknowledges a unit only after it is committed; after a restart
/// with the same data folder it continues all unfinished jobs.
/// Its lock is never held during a call of the ledger or of a file, so that slow storage does not delay leases: the
/// committer writes, and what clients ask of ended jobs is read without the lock.
/// Threads: safe; it has several of its own (committer, finisher, housekeeping, and those for tasks).
class Coordinator final : private Committer::Listener, public cluster::MemberHost {
 public:
  using StatusAnswer = std::function<void(absl::StatusOr<v1::JobStatus>)>;

  /// Restores the unfinished jobs from the ledger. The caller has claimed the folder. `folder`, `store`,
  /// `assets` and `finisher` must outlive it.
  static absl::StatusOr<std::unique_ptr<Coordinator>> Create(const CoordinatorOptions& options,
                                                             const DataFolder& folder,
                                                             ledger::JobStore* store, AssetStore* assets,
                                                             FrameFinisher* finisher);
  ~Coordinator() override;
  /// From now on no lease is granted, and workers that disconnect do not count as lost with their units.
  void StopLeasing();
  /// Commits the accepted units and stops the threads. Later calls are safe, but no lease is granted any
  /// more.
  void Shutdown();

  // As one of several, see coordinator_farm.cc.
  const ledger::Owner& owner() const { return owner_; }
  /// Where others reach it, for display.
  void SetAddress(const std::string& address);
  void SetFigures(ledger::Member* member) override;
  void Adopt(const std::vector<ledger::AdoptedJob>& jobs) override;
  void MoveWorkers(const cluster::WorkerMove& move) override;
  void SendWorkersAway(const std::string& address) override;
  void OnExpelled() override;
  void LookAtOthers(const std::vector<ledger::Member>& members) override;
  /// The epoch that a job belongs to. Errors: those of JobStore::GetJob.
  absl::StatusOr<ledger::Epoch> OwnerOf(const job::JobId& job);

  // Calls of clients; farm.proto documents them and their errors.
  absl::StatusOr<v1::FindMissingAssetsResponse> FindMissingAssets(
      const v1::FindMissingAssetsRequest& request) const;
  absl::StatusOr<v1::FindUploadResponse> FindUpload(const v1::FindUploadRequest& request) const;
  /// `caller` is whose upload it is, see Limits::uploads.
  absl::StatusOr<std::unique_ptr<AssetUpload>> ReceiveAsset(const v1::AssetRef& asset,
                                                            const std::string& caller);
  absl::StatusOr<v1::SubmitJobResponse> SubmitJob(const v1::SubmitJobRequest& request);
  absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id);
  /// Whose job it is. Errors: those of GetJob.
  absl::StatusOr<std::string> UserOf(const std::string& job_id);
  absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request);
  /// Cancels a job. Calls `done` once: when the end of the job is recorded, or with kResourceExhausted when it cannot be
  /// recorded now; then the job ends as soon as it can. `done` is called at once or from another thread, without a
  /// lock.
  void CancelJob(const std::string& job_id, StatusAnswer done);
  // Changes of a job that exists. Each calls `done` once, at once or from another thread, without a lock. The changes
  // are made one after the other.
  void RetryJob(const v1::RetryJobRequest& request, StatusAnswer done);
  void AddSamples(const v1::AddSamplesRequest& request, StatusAnswer done);
  /// The answer is the status that the job had last.
  void DeleteJob(const v1::DeleteJobRequest& request, StatusAnswer done);
  absl::StatusOr<v1::ServerStatus> GetServerStatus();
  /// What the metrics endpoint shows. Linear in active jobs and workers.
  monitoring::FarmFigures Figures();
  const monitoring::FarmTimings& timings() const { return timings_; }
  Traffic& traffic() { return traffic_; }
  /// Whether the storage can be written.
  const StorageState& storage() const { return storage_; }
  /// Notes an error of the storage that occurred outside the coordinator, and returns what the caller is told.
  absl::Status NoteError(const absl::Status& status);
  /// These three record what they change, so that it holds after a restart. In coordinator_control.cc, as are all calls
  /// of operators.
  absl::StatusOr<v1::JobStatus> PauseJob(const std::string& job_id);
  absl::StatusOr<v1::JobStatus> ResumeJob(const std::string& job_id);
  absl::StatusOr<v1::JobStatus> SetJobPriority(const v1::SetJobPriorityRequest& request);
  absl::StatusOr<v1::ExplainJobResponse> ExplainJob(const std::string& job_id);
  absl::StatusOr<v1::ListWorkersResponse> ListWorkers(const v1::ListWorkersRequest& request);
  absl::StatusOr<v1::WorkerStatus> DrainWorker(const v1::WorkerRequest& request);
  absl::StatusOr<v1::WorkerStatus> BlockWorker(const v1::WorkerRequest& request);
  absl::StatusOr<v1::WorkerStatus> ReadmitWorker(const v1::WorkerRequest& request);
  absl::StatusOr<v1::GetLogResponse> GetLog(const v1::GetLogRequest& request);
  /// Committed units of a job, for previews of one of its frames. Errors: those of GetPreview about the job and the frame.
  absl::StatusOr<int64_t> CountUnits(const job::JobId& job, int32_t frame);
  absl::StatusOr<rpc::ByteSender> OpenResult(const v1::DownloadResultRequest& request);
  /// Calls `watcher` with the job's status at once and after changes, at most ten times a second and once more when
  /// the job ends or is lost, until Unwatch.
  absl::Status Watch(const std::string& job_id, JobWatcher* watcher);
  /// After it returns the watcher is not called again. No effect on a watcher that does not watch.
  void Unwatch(JobWatcher* watcher);

  // Calls of workers, made by WorkerSession; see worker.proto. `caller` is the identity of the connection, see
  // access::KeyOf: a worker's id is of use to its own identity only.
  absl::StatusOr<v1::JobSpec> FetchSpec(const v1::FetchSpecRequest& request, const std::string& caller);
  /// Whether the worker may read the asset.
  absl::Status CheckFetch(const v1::FetchAssetRequest& request, const std::string& caller);
  /// After CheckFetch.
  absl::StatusOr<rpc::ByteSender> OpenAsset(const v1::FetchAssetRequest& request) const;
  /// Sends Welcome to a worker and grants it leases. With access control its name is that of its certificate, so that a
  /// block holds for all processes that have it, and they count as one party in audits. `sink` is used until RemoveWorker
  /// has returned.
  absl::StatusOr<job::WorkerId> AddWorker(const v1::Hello& hello, const access::Identity& caller,
                                          WorkerSink* sink);
  void RemoveWorker(job::WorkerId worker);
  void OnHeartbeat(job::WorkerId worker, const v1::Heartbeat& heartbeat);
  /// Keeps lines that the worker has sent of its log, for GetLog.
  void KeepLog(job::WorkerId worker, const google::protobuf::RepeatedPtrField<v1::LogEvent>& lines);
  /// The unit of a lease that the worker holds; nullopt if it does not hold it.
  std::optional<LeasedUnit> FindLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt);
  /// Accepts a complete unit whose layout and values are valid.
  void Deliver(job::WorkerId worker, film::EncodedUnit unit);
  /// Accepts the result of a plan unit that the worker holds, and commits it: only then is the job divided into the units
  /// of its frames. In coordinator_plans.cc.
  /// Errors: those of job::PlannedSpec.
  absl::Status DeliverPlan(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                           const v1::Plan& plan);
  /// Acknowledges a unit that is not wanted, so that the worker drops it.
  void Dismiss(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt);
  /// Fails a delivered unit that is not valid, and tells the worker the reason.
  void RefuseUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                  const std::string& reason);
  void FailUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                const std::string& error, bool permanent);
  /// The worker could not get an asset of the unit's job. If it is not here or damaged, the job waits until it is
  /// uploaded again; otherwise the unit has failed.
  void OnAssetMissing(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                      const std::string& sha256, const std::string& error);
  /// An asset was uploaded: jobs that wait for it go on.
  void OnAssetStored(const std::string& sha256);
  /// The worker will not deliver these units.
  void HandBack(job::WorkerId worker, const v1::HandBack& message);
  /// The worker wants no more leases; answers with Released.
  void OnLeaving(job::WorkerId worker, const std::string& reason);

  /// Asks up to `count` connected workers to go to the coordinator at `address`, those with the fewest leases first. They
  /// get no more leases here, and finish those that they have. In coordinator_in_hand.cc.
  void MoveWorkers(int count, const std::string& address);

 private:
  /// Whether the frame's result is written. Errors: kNotFound; those of the ledger.
  absl::StatusOr<bool> IsFinished(const job::JobId& job, int32_t frame);
  struct ConnectedWorker {
    std::string name;     // see AddWorker
    std::string process;  // what the worker calls itself
    std::string caller;   // access::KeyOf
    int slots;
    WorkerSink* sink;
    absl::Time connected;             // by the wall clock, for display
    std::set<job::JobId> known_jobs;  // jobs of which the worker got leases
  };
  struct CommittedFrame {
    job::JobId job;
    int32_t number = 0;
    /// The round whose estimate is due; kResult: the frame is committed.
    int round = kResult;
    static constexpr int kResult = -1;
    /// Render time of the job when that round was committed, and its camera samples, of all frames.
    absl::Duration rendered = {};
    int64_t samples = 0;
    FrameKey key() const { return {job, number}; }
    /// Number of times that finishing it has failed, and when it may be tried again.
    int failures = 0;
    /// Number of times that the storage could not be written meanwhile, which is no failure of the frame.
    int waits = 0;
    absl::Time not_before = absl::InfinitePast();
  };
  /// A unit that a worker has in hand, see v1::Hello. `attempt`: of the connection that broke.
  struct UnitInHand {
    job::WorkerId worker;
    job::UnitRef unit;
    job::Attempt attempt;
    absl::Time until;  // when it is forgotten here
  };
  /// What a job that is to be entered into the scheduler has on the disk.
  struct LoadedJob {
    ledger::JobRecord record;
    std::vector<int32_t> finished;
    /// Committed units of the other frames, these frames, and the ends of the logs that this coordinator writes.
    std::vector<scheduler::RestoredUnit> units;
    std::set<int32_t> frames;
    std::map<int32_t, uint64_t> committed_bytes;
    /// Rounds of the frames with committed units, with adaptive sampling.
    std::map<int32_t, std::shared_ptr<const job::FrameRounds>> rounds;
    std::vector<job::Prerequisite> after;
    /// Why the job cannot continue; empty if it can.
    std::string error;
  };
  /// A job that is being changed: neither the scheduler nor the committer nor the finisher has anything of it.
  struct SuspendedJob {
    /// What clients see meanwhile.
    v1::JobStatus shown;
    bool committer_is_done = false;
  };
  /// A job that has ended, whose end is being recorded.
  struct EndingJob {
    /// With the end.
    ledger::JobRecord record;
    /// What clients see until the end is recorded.
    v1::JobStatus shown;
    std::vector<StatusAnswer> cancels;
  };

  /// The connected workers that a request means, and the name that they have in common.
  struct NamedWorkers {
    std::string name;
    std::vector<job::WorkerId> connected;
  };

  Coordinator(const CoordinatorOptions& options, const DataFolder& folder, ledger::JobStore* store,
              AssetStore* assets, FrameFinisher* finisher, ledger::Owner owner);
  // Before any other thread has the object; see coordinator_restore.cc.
  absl::Status Restore();
  absl::Status RestoreBlockedWorkers();
  /// Errors: those of the ledger that are not of this job alone.
  absl::Status RestoreJob(const ledger::JobRecord& record);
  /// Reads what the ledger and the data folder have of an unfinished job. Errors: those of the storage.
  absl::StatusOr<LoadedJob> LoadJob(const ledger::JobRecord& record);
  absl::Status LoadProgress(LoadedJob* loaded);
  absl::Status LoadRounds(LoadedJob* loaded) const;
  absl::Status RestoreFiles(const ledger::JobRecord& record, const std::vector<int32_t>& finished);
  /// Makes a loaded job active.
  void EnterJob(const LoadedJob& loaded) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Starts jobs whose manifest lies here but that the ledger does not have, and clears away after jobs that have ended.
  absl::StatusOr<std::vector<ledger::JobRecord>> FindForgottenJobs();
  absl::Status CheckSpec(const v1::JobSpec& spec) const;
  /// That the files of a job are not too large together.
  absl::Status CheckAssetBytes(const v1::JobSpec& spec) const;
  /// Counts a submission of the user until EndSubmission. Errors: kResourceExhausted where it has too many jobs.
  absl::Status BeginSubmission(const std::string& user);
  void EndSubmission(const std::string& user);
  /// Checks what a new job must meet, and records it.
  absl::StatusOr<job::JobId> SubmitNewJob(ledger::NewJob job);
  /// A request that is recorded: starts its job if an error of the storage has left open whether it is. Returns `id`.
  absl::StatusOr<job::JobId> StartIfUncertain(const job::JobId& id);
  absl::StatusOr<job::JobId> RecordJob(const ledger::NewJob& job,
                                       const std::vector<job::Prerequisite>& after);
  /// From now on lines about the job have its trace and its user.
  void LabelJob(const job::JobId& job, const v1::Scheduling& scheduling) const;
  /// Starts a recorded job. `was_uncertain`: it is one of uncertain_jobs_, unless another call was first.
  void StartJob(ledger::JobRecord record, const std::vector<job::Prerequisite>& after, bool was_uncertain);
  /// Adds the jobs of a page that the request asks for.
  absl::Status AddListed(const ledger::JobPage& page, const v1::ListJobsRequest& request,
                         v1::ListJobsResponse* response);

  // As one of several, see coordinator_farm.cc. All but the first run on farm_thread_.
  /// Leases that the job has or could have.
  int64_t LeasesWanted(const job::JobId& job, const ledger::JobRecord& record)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Makes a job that is this coordinator's in the ledger one in memory. Waits for the storage.
  void AdoptJob(const job::JobId& job);
  absl::Status TryToAdopt(const job::JobId& job);
  /// Jobs whose client may have got the answer elsewhere.
  void StartUncertainJobs();
  /// Assets that jobs wait for and others have stored.
  void FindStoredAssets();
  /// Jobs of others that jobs wait for.
  void LookAtPrerequisites();
  /// What others have recorded of blocked workers.
  void FollowBlockedWorkers();
  /// Sends workers with units in hand to the owners of their jobs.
  void RouteInHand(const std::vector<ledger::Member>& members);

  // Plans, see coordinator_plans.cc.
  /// The job's plan; without decisions if it has none. Errors: those of the ledger.
  absl::StatusOr<v1::Plan> PlanOf(const job::JobId& job);
  /// Writes the plan of a job to the disk and the ledger. On the committer's thread.
  absl::Status RecordPlan(const job::JobId& job, const v1::JobSpec& planned);
  /// The plan of an accepted unit is recorded, or cannot be.
  void OnPlanRecorded(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                      const v1::JobSpec& planned, const absl::Status& status);

  // Dependencies, see coordinator_dependencies.cc.
  /// As ReadPrerequisites. Errors: also kInvalidArgument naming a job that is not known, or for too many.
  absl::StatusOr<std::vector<job::Prerequisite>> CheckAfter(const v1::Scheduling& scheduling);
  /// The jobs that `scheduling` names, in the states that the ledger has.
  absl::StatusOr<std::vector<job::Prerequisite>> ReadPrerequisites(const v1::Scheduling& scheduling);
  /// Lets an active job wait for others, as they are now.
  void AwaitPrerequisites(const job::JobId& job, std::vector<job::Prerequisite> after)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Looks again at jobs that had not ended when they were read, and may have left memory before AwaitPrerequisites.
  void CheckPrerequisites(const std::vector<job::Prerequisite>& after);
  /// Starts or fails jobs that no longer wait.
  void Settle(const job::Settled& settled) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool IsInMemory(const job::JobId& job) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return active_jobs_.contains(job) || ending_jobs_.contains(job) || suspended_jobs_.contains(job);
  }

  // Changes of jobs, see coordinator_reopen.cc. All but the first run on the thread of changes.
  /// Calls `change` on the thread of changes, and `done` with its outcome or when the coordinator stops.
  void Change(std::function<absl::StatusOr<v1::JobStatus>()> change, StatusAnswer done);
  void AnswerChange(int64_t number, const absl::StatusOr<v1::JobStatus>& answer);
  absl::StatusOr<v1::JobStatus> Reopen(const job::JobId& job, const job::ReopenRequest& request);
  absl::StatusOr<v1::JobStatus> Delete(const job::JobId& job);
  absl::StatusOr<v1::JobStatus> CancelNow(const job::JobId& job);
  absl::StatusOr<job::ReopenPlan> PlanFor(const job::JobId& job, const job::ReopenRequest& request);
  /// Takes a job away from scheduler, finisher and committer. Errors: kUnavailable when the coordinator stops.
  absl::Status Suspend(const job::JobId& job, v1::JobStatus shown);
  /// Waits while the end of the job is being recorded.
  void AwaitEnd(const job::JobId& job);
  absl::Status ChangeFiles(const job::JobId& job, const job::ReopenPlan& plan);
  /// Makes a suspended job what the ledger says: active or ended. Waits for the storage.
  void Resume(const job::JobId& job);
  absl::StatusOr<std::optional<LoadedJob>> LoadSuspended(const job::JobId& job);

  bool IsWanted(const job::JobId& job) override;
  void OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) override;
  void OnUnitsLost(const job::JobId& job, int32_t frame, const absl::Status& cause,
                   const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) override;
  void OnUnitsDiscarded(const FrameKey& frame, const std::vector<job::UnitKey>& units,
                        const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) override;
  void OnStorageAvailable() override;
  void CountCommitted(const AcceptedUnit& unit) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Audits, see coordinator_audits.cc.
  /// Carries out what the scheduler has concluded from audits.
  void FollowAudits() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Takes back the units of a faulty worker, and records that it is blocked.
  void ConvictWorker(const scheduler::FaultyWorker& faulty) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  /// Grants leases to all workers that have free slots.
  void GrantLeases() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Tells the workers of new leases, which are in the order of workers.
  void SendGrants(const std::vector<scheduler::GrantedLease>& leases) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Units in hand, see coordinator_in_hand.cc.
  void MoveWorker(job::WorkerId worker, const std::string& address, bool at_once = false)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Moves the workers that have units of the job in hand.
  void MoveWorkersWith(const job::JobId& job, const std::string& address);
  void NoteInHand(job::WorkerId worker, const v1::Hello& hello) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ForgetInHand(absl::FunctionRef<bool(const UnitInHand&)> condition)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Grants leases of the units in hand of jobs that are active, and lets the workers drop the others of these jobs.
  void GrantInHand() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void RegrantTo(job::WorkerId worker, const std::vector<UnitInHand>& units)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Tells the workers which of their leases have become void.
  void SendVoided() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Acknowledge(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                   const std::string& refused = "") ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Ends a job: its leases are void at once, its end is recorded by the committer.
  void EndJob(const job::JobId& job, v1::JobState state, const std::string& error)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Voids the leases of a job and forgets it, except what `active_jobs_` has.
  void StopRendering(const job::JobId& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status RecordEnd(const job::JobId& job, v1::JobState state, const std::string& error);
  void OnEndRecorded(const job::JobId& job, const absl::Status& status);
  /// Answers cancellations that wait for the end of the job.
  void AnswerCancels(const job::JobId& job, const absl::StatusOr<v1::JobStatus>& answer);
  /// Deletes rows of units that are not needed any more, some at a time.
  void PurgeUnits();
  /// Status of a job that is active or whose end is being recorded.
  std::optional<v1::JobStatus> StatusInMemory(const job::JobId& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Reads the ledger for a job that has ended.
  absl::StatusOr<v1::JobStatus> StatusOf(const job::JobId& job);
  /// Of a job that was not in memory: kUnavailable for one that goes on. Who asks again finds it here, or at its owner.
  static absl::Status CheckHasEnded(const v1::JobStatus& status);
  ledger::OwnedJob Owned(const job::JobId& job) const { return {job, owner_.epoch}; }
  /// Changes how an active job is scheduled, in the ledger first.
  absl::StatusOr<v1::JobStatus> ChangeScheduling(const std::string& job_id,
                                                 absl::FunctionRef<void(v1::Scheduling*)> change);
  /// Records the scheduling where `recover` reads it.
  void RecordScheduling(const job::JobId& job, const v1::Scheduling& scheduling);
  void Reschedule(const job::JobId& job, const v1::Scheduling& scheduling)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Adds why frames of the job that are rendered have no result yet.
  void ExplainFinishing(const job::JobId& job, v1::ExplainJobResponse* response)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Whether a connected worker has had a lease of the active job.
  absl::Status CheckHasLeases(const std::string& worker_id, const std::string& caller, const job::JobId& job)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void AwaitAsset(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                  const v1::AssetRef& asset);
  void ExplainAsset(const job::JobId& job, v1::ExplainJobResponse* response)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<NamedWorkers> FindWorkers(const std::string& worker) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Up to `limit` connected workers after this one: those that render `job`, all if it is empty.
  void AddWorkers(job::WorkerId after, int limit, const std::string& job,
                  v1::ListWorkersResponse* response) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  v1::WorkerStatus StatusOf(const scheduler::WorkerInfo& info) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::string NameOf(job::WorkerId worker) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void RunFinisher();
  /// Waits for a committed frame; nullopt once the coordinator is stopping.
  std::optional<CommittedFrame> NextCommittedFrame();
  /// The first frame that may be finished now.
  std::deque<CommittedFrame>::iterator FindDueFrame() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Lets a frame be tried again later, or fails its job.
  void RetryFrame(CommittedFrame frame, const absl::Status& error) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Lets a frame whose result could not be written wait for the storage.
  void AwaitStorage(CommittedFrame frame, const absl::Status& error) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void RecordFinished(const CommittedFrame& frame, const absl::StatusOr<v1::FrameReport>& report);
  /// Queues what is due for a frame: its result, or the estimate of a round.
  void QueueDue(const FrameKey& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Whether what the frame was queued for is still due.
  bool IsDue(const CommittedFrame& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Opens the rounds that the frame's record has.
  void OnRoundEstimated(const CommittedFrame& frame, const v1::FrameReport& report)
      ABSL_LOCKS_EXCLUDED(mutex_);
  void OnFrameRecorded(const CommittedFrame& frame, const v1::FrameReport& report,
                       const absl::Status& status);
  /// Deletes a file or folder, at low priority.
  void DeleteFiles(const std::string& path);
  void RunHousekeeping();
  absl::Duration UntilNextHousekeeping() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ExpireLeases() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Logs leases that are late, and ends the jobs that cannot go on because of them.
  void ReportLate(const std::vector<scheduler::LateLease>& late) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void NotifyWatchers() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Bounds the frames in flight by what the machine has and all jobs demand.
  void LimitFrames(uint64_t free_disk_bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// The same for a job that is new in the scheduler, before any of its units is leased.
  void LimitFramesFor(const job::JobId& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const CoordinatorOptions options_;
  const DataFolder folder_;
  ledger::JobStore* const store_;
  AssetStore* const assets_;
  FrameFinisher* const finisher_;
  /// This run of the coordinator, which owns all active jobs.
  const ledger::Owner owner_;
  StorageState storage_;
  monitoring::FarmTimings timings_;
  Traffic traffic_;

  /// One change of a job's scheduling or of the blocked workers at a time, in the ledger and here. Taken before mutex_.
  absl::Mutex control_mutex_;
  absl::Mutex mutex_;
  bool leasing_ ABSL_GUARDED_BY(mutex_) = true;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  scheduler::Scheduler scheduler_ ABSL_GUARDED_BY(mutex_);
  std::map<job::JobId, ledger::JobRecord> active_jobs_ ABSL_GUARDED_BY(mutex_);
  std::map<job::JobId, EndingJob> ending_jobs_ ABSL_GUARDED_BY(mutex_);
  /// Jobs whose submission ended with an error of the ledger, which may have recorded them.
  std::set<job::JobId> uncertain_jobs_ ABSL_GUARDED_BY(mutex_);
  /// Submissions of each user that are being recorded.
  std::map<std::string, int> submissions_ ABSL_GUARDED_BY(mutex_);
  std::map<job::JobId, SuspendedJob> suspended_jobs_ ABSL_GUARDED_BY(mutex_);
  job::Dependencies dependencies_ ABSL_GUARDED_BY(mutex_);
  /// The frame that is being finished, and whether units of it were taken back since.
  std::optional<FrameKey> finished_frame_ ABSL_GUARDED_BY(mutex_);
  bool finished_in_vain_ ABSL_GUARDED_BY(mutex_) = false;
  /// Changes that were asked for and are not answered.
  std::map<int64_t, StatusAnswer> changes_ ABSL_GUARDED_BY(mutex_);
  int64_t next_change_ ABSL_GUARDED_BY(mutex_) = 1;
  /// When the render time of an active job would have begun, had all of it been spent without a break.
  std::map<job::JobId, absl::Time> render_starts_ ABSL_GUARDED_BY(mutex_);
  /// SHA-256 of the files of a job's scene, of jobs that workers have fetched files of.
  std::map<job::JobId, std::set<std::string>> scene_files_ ABSL_GUARDED_BY(mutex_);
  std::map<job::JobId, UnitBytes> unit_bytes_ ABSL_GUARDED_BY(mutex_);
  /// With adaptive sampling: error of a frame as its last estimate predicts it.
  std::map<job::JobId, double> predicted_errors_ ABSL_GUARDED_BY(mutex_);
  /// What the frames in flight are bounded by.
  FrameResources frame_resources_ ABSL_GUARDED_BY(mutex_);
  FrameDemand largest_frame_ ABSL_GUARDED_BY(mutex_);
  int64_t next_worker_ ABSL_GUARDED_BY(mutex_) = 1;
  int64_t units_committed_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t samples_committed_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<job::WorkerId, ConnectedWorker> workers_ ABSL_GUARDED_BY(mutex_);
  /// Units that connected workers have in hand, of jobs that are not active here.
  std::map<job::JobId, std::vector<UnitInHand>> in_hand_ ABSL_GUARDED_BY(mutex_);
  std::deque<CommittedFrame> committed_frames_ ABSL_GUARDED_BY(mutex_);
  /// Number of times that units of an unfinished frame were lost.
  std::map<std::pair<job::JobId, int32_t>, int> losses_ ABSL_GUARDED_BY(mutex_);
  /// What jobs wait for whose scene is not complete; the scheduler grants them no leases.
  std::map<job::JobId, v1::AssetRef> wanted_assets_ ABSL_GUARDED_BY(mutex_);
  std::map<JobWatcher*, job::JobId> watchers_ ABSL_GUARDED_BY(mutex_);
  std::set<job::JobId> changed_jobs_ ABSL_GUARDED_BY(mutex_);
  absl::Time watchers_notified_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  std::string address_ ABSL_GUARDED_BY(mutex_);
  std::atomic<bool> purging_{false};
  std::atomic<bool> looking_{false};
  threads::Event housekeeping_;
  threads::Event finishing_;
  threads::Event changing_;
  threads::Event adopting_;

  threads::TaskThread deleter_{threads::TaskThread::Priority::kLowest};  // of files
  threads::TaskThread purger_{threads::TaskThread::Priority::kNormal};   // of rows
  Janitor janitor_;
  threads::TaskThread changer_{threads::TaskThread::Priority::kNormal};
  threads::TaskThread farm_thread_{threads::TaskThread::Priority::kNormal};
  std::unique_ptr<Committer> committer_;
  std::thread finisher_thread_;
  std::thread housekeeping_thread_;
};

}  // namespace lumifold::server
