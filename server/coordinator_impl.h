#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "server/asset_store.h"
#include "server/committer.h"
#include "server/data_folder.h"
#include "server/frame_finisher.h"
#include "server/ledger/job_store.h"
#include "server/scheduler/scheduler.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

struct CoordinatorOptions {
  absl::Duration lease = absl::Seconds(30);
  /// Interval of the workers' heartbeats.
  absl::Duration heartbeat = absl::Seconds(5);
  /// Pause before a frame whose filter process was killed is tried again; the next pause is four times as long.
  absl::Duration finish_pause = absl::Seconds(5);
  std::function<absl::Time()> now;
  std::function<uint64_t()> random;
  std::shared_ptr<spdlog::logger> log;
};

/// What a worker has to deliver for a lease.
struct LeasedUnit {
  Rect rect;
  SampleRange samples;
};

/// Queue of messages to a worker. Send never blocks and never calls back.
class WorkerSink {
 public:
  virtual ~WorkerSink() = default;
  virtual void Send(const v1::CoordinatorMessage& message) = 0;
};

/// Receives the status of a job. OnStatus only queues: it never blocks and never calls back.
class JobWatcher {
 public:
  virtual ~JobWatcher() = default;
  virtual void OnStatus(const v1::JobStatus& status) = 0;
};

/// Makes all decisions of the coordinator: accepts jobs, grants leases, commits each unit once, finishes
/// frames, ends jobs. Independent of gRPC. Acknowledges a unit only after it is committed; after a restart
/// with the same data folder it continues all unfinished jobs.
/// Threads: safe; it has three of its own (committer, finisher, housekeeping).
class Coordinator final : private Committer::Listener {
 public:
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

  // Calls of clients; farm.proto documents them and their errors.
  absl::StatusOr<v1::FindMissingAssetsResponse> FindMissingAssets(
      const v1::FindMissingAssetsRequest& request) const;
  absl::StatusOr<v1::FindUploadResponse> FindUpload(const v1::FindUploadRequest& request) const;
  absl::StatusOr<std::unique_ptr<AssetUpload>> ReceiveAsset(const v1::AssetRef& asset);
  absl::StatusOr<v1::SubmitJobResponse> SubmitJob(const v1::SubmitJobRequest& request);
  absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id);
  absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request);
  absl::StatusOr<v1::JobStatus> CancelJob(const std::string& job_id);
  absl::StatusOr<rpc::ByteSender> OpenResult(const v1::DownloadResultRequest& request);
  /// Calls `watcher` with the job's status at once and after changes, at most ten times a second, until
  /// Unwatch.
  absl::Status Watch(const std::string& job_id, JobWatcher* watcher);
  /// After it returns the watcher is not called again. No effect on a watcher that does not watch.
  void Unwatch(JobWatcher* watcher);

  // Calls of workers, made by WorkerSession; see worker.proto.
  absl::StatusOr<rpc::ByteSender> OpenAsset(const v1::FetchAssetRequest& request) const;
  /// Sends Welcome to a worker and grants it leases. `sink` is used until RemoveWorker has returned.
  absl::StatusOr<job::WorkerId> AddWorker(const v1::Hello& hello, WorkerSink* sink);
  void RemoveWorker(job::WorkerId worker);
  void OnHeartbeat(job::WorkerId worker, const v1::Heartbeat& heartbeat);
  /// The unit of a lease that the worker holds; nullopt if it does not hold it.
  std::optional<LeasedUnit> FindLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt);
  /// Accepts a complete unit whose layout and values are valid.
  void Deliver(job::WorkerId worker, film::StoredUnit unit);
  /// Acknowledges a unit that is not wanted, so that the worker drops it.
  void Dismiss(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt);
  /// Fails a delivered unit that is not valid, and tells the worker the reason.
  void RefuseUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                  const std::string& reason);
  void FailUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                const std::string& error, bool permanent);

 private:
  struct ConnectedWorker {
    std::string name;
    WorkerSink* sink;
    std::set<job::JobId> known_jobs;  // jobs whose specs were sent to the worker
  };
  struct CommittedFrame {
    job::JobId job;
    int32_t number = 0;
    /// Number of times that finishing it has failed, and when it may be tried again.
    int failures = 0;
    absl::Time not_before = absl::InfinitePast();
  };

  Coordinator(const CoordinatorOptions& options, const DataFolder& folder, ledger::JobStore* store,
              AssetStore* assets, FrameFinisher* finisher);
  absl::Status Restore();
  absl::Status RestoreJob(const ledger::JobRecord& record) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status CheckSpec(const v1::JobSpec& spec) const;
  void StartJob(const ledger::NewJob& job);

  bool IsWanted(const job::JobId& job) override;
  void OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) override;
  void OnUnitsLost(const job::JobId& job, int32_t frame, const absl::Status& cause,
                   const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) override;
  void CountCommitted(const AcceptedUnit& unit) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  /// Grants leases to all workers that have free slots.
  void GrantLeases() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Acknowledge(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                   const std::string& refused = "") ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void EndJob(const job::JobId& job, v1::JobState state, const std::string& error)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<v1::JobStatus> StatusOf(const job::JobId& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::string NameOf(job::WorkerId worker) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void RunFinisher();
  /// Waits for a committed frame; nullopt once the coordinator is stopping.
  std::optional<CommittedFrame> NextCommittedFrame();
  /// The first frame that may be finished now.
  std::deque<CommittedFrame>::iterator FindDueFrame() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Lets a frame be tried again later, or fails its job.
  void RetryFrame(CommittedFrame frame, const absl::Status& error) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void RecordFinished(const CommittedFrame& frame, const absl::StatusOr<v1::StageTimes>& times);
  void RunHousekeeping();
  absl::Duration UntilNextHousekeeping() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ExpireLeases() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void NotifyWatchers() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  bool FinisherHasWork() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return stopping_ || FindDueFrame() != committed_frames_.end();
  }

  const CoordinatorOptions options_;
  const DataFolder folder_;
  ledger::JobStore* const store_;
  AssetStore* const assets_;
  FrameFinisher* const finisher_;

  absl::Mutex mutex_;
  bool leasing_ ABSL_GUARDED_BY(mutex_) = true;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  scheduler::Scheduler scheduler_ ABSL_GUARDED_BY(mutex_);
  std::map<job::JobId, ledger::JobRecord> active_jobs_ ABSL_GUARDED_BY(mutex_);
  int64_t next_worker_ ABSL_GUARDED_BY(mutex_) = 1;
  std::map<job::WorkerId, ConnectedWorker> workers_ ABSL_GUARDED_BY(mutex_);
  std::deque<CommittedFrame> committed_frames_ ABSL_GUARDED_BY(mutex_);
  /// Number of times that units of an unfinished frame were lost.
  std::map<std::pair<job::JobId, int32_t>, int> losses_ ABSL_GUARDED_BY(mutex_);
  std::map<JobWatcher*, job::JobId> watchers_ ABSL_GUARDED_BY(mutex_);
  std::set<job::JobId> changed_jobs_ ABSL_GUARDED_BY(mutex_);
  absl::Time watchers_notified_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  absl::CondVar housekeeping_;

  std::unique_ptr<Committer> committer_;
  std::thread finisher_thread_;
  std::thread housekeeping_thread_;
};

}  // namespace lumifold::server
