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
  /// How often workers are asked to say that they live.
  absl::Duration heartbeat = absl::Seconds(5);
  std::function<absl::Time()> now;
  std::function<uint64_t()> random;
  std::shared_ptr<spdlog::logger> log;
};

/// Where messages for a worker go. Send only queues: it never blocks and never calls back.
class WorkerSink {
 public:
  virtual ~WorkerSink() = default;
  virtual void Send(const v1::CoordinatorMessage& message) = 0;
};

/// Who wants to know how a job fares. OnStatus only queues: it never blocks and never calls back.
class JobWatcher {
 public:
  virtual ~JobWatcher() = default;
  virtual void OnStatus(const v1::JobStatus& status) = 0;
};

/// All decisions of the coordinator: takes jobs, grants leases, merges units once, has frames finished, ends
/// jobs. Knows nothing of gRPC. What it acknowledges is durable first; started again over the same data
/// folder it goes on where it was.
/// Threads: safe; it has three of its own (committer, finisher, housekeeping).
class Coordinator final : private Committer::Listener {
 public:
  /// Reads the unfinished jobs back from the ledger. The folder is claimed; all four must outlive it.
  static absl::StatusOr<std::unique_ptr<Coordinator>> Create(const CoordinatorOptions& options,
                                                             const DataFolder& folder,
                                                             ledger::JobStore* store, AssetStore* assets,
                                                             FrameFinisher* finisher);
  ~Coordinator() override;
  /// Stops the threads; what was accepted is stored first. Calls after it are still safe but decide nothing
  /// new.
  void Shutdown();

  // For clients; farm.proto says what each does and its errors.
  absl::StatusOr<v1::FindMissingAssetsResponse> FindMissingAssets(
      const v1::FindMissingAssetsRequest& request) const;
  absl::StatusOr<std::unique_ptr<AssetUpload>> ReceiveAsset(const v1::AssetRef& asset);
  absl::StatusOr<v1::SubmitJobResponse> SubmitJob(const v1::SubmitJobRequest& request);
  absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id);
  absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request);
  absl::StatusOr<v1::JobStatus> CancelJob(const std::string& job_id);
  absl::StatusOr<rpc::ByteSender> OpenResult(const v1::DownloadResultRequest& request);
  /// `watcher` hears of the job at once and after changes, at most ten times a second, until Unwatch.
  absl::Status Watch(const std::string& job_id, JobWatcher* watcher);
  /// After it returns the watcher is not called again. Harmless for one that does not watch.
  void Unwatch(JobWatcher* watcher);

  // For workers; worker.proto. Called through WorkerSession.
  absl::StatusOr<rpc::ByteSender> OpenAsset(const v1::FetchAssetRequest& request) const;
  /// Welcomes a worker and fills its slots. `sink` is used until RemoveWorker has returned.
  absl::StatusOr<scheduler::WorkerId> AddWorker(const v1::Hello& hello, WorkerSink* sink);
  void RemoveWorker(scheduler::WorkerId worker);
  void OnHeartbeat(scheduler::WorkerId worker, const v1::Heartbeat& heartbeat);
  /// The pixels of a lease the worker holds; nothing where it does not.
  std::optional<Rect> FindLease(scheduler::WorkerId worker, const scheduler::UnitRef& unit,
                                scheduler::Attempt attempt);
  /// A unit arrived whole and well formed.
  void Deliver(scheduler::WorkerId worker, film::StoredUnit unit);
  /// The last piece of a unit arrived that is not wanted: the worker may forget it.
  void Dismiss(scheduler::WorkerId worker, const scheduler::UnitRef& unit, scheduler::Attempt attempt);
  void FailUnit(scheduler::WorkerId worker, const scheduler::UnitRef& unit, scheduler::Attempt attempt,
                const std::string& error, bool permanent);

 private:
  struct ConnectedWorker {
    std::string name;
    WorkerSink* sink;
    std::set<scheduler::JobId> known_jobs;  // whose specs it has been sent
  };
  struct MergedFrame {
    scheduler::JobId job;
    int32_t frame;
  };

  Coordinator(const CoordinatorOptions& options, const DataFolder& folder, ledger::JobStore* store,
              AssetStore* assets, FrameFinisher* finisher);
  absl::Status Restore();
  absl::Status RestoreJob(const ledger::JobRecord& record) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status CheckSpec(const v1::JobSpec& spec) const;
  void StartJob(const ledger::NewJob& job);

  bool IsWanted(const scheduler::JobId& job) override;
  void OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) override;
  void CountCommitted(const AcceptedUnit& unit) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void GrantTo(scheduler::WorkerId worker) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void GrantToAll() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Acknowledge(scheduler::WorkerId worker, const scheduler::UnitRef& unit, scheduler::Attempt attempt)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void EndJob(const scheduler::JobId& job, v1::JobState state, const std::string& error)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<v1::JobStatus> StatusOf(const scheduler::JobId& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::string NameOf(scheduler::WorkerId worker) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void RunFinisher();
  void RecordFinished(const MergedFrame& merged, const absl::StatusOr<v1::StageTimes>& times);
  void RunHousekeeping();
  absl::Duration UntilNextChore() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ExpireLeases() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void TellWatchers() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  bool FinisherHasWork() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return stopping_ || !merged_frames_.empty();
  }

  const CoordinatorOptions options_;
  const DataFolder folder_;
  ledger::JobStore* const store_;
  AssetStore* const assets_;
  FrameFinisher* const finisher_;

  absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  scheduler::Scheduler scheduler_ ABSL_GUARDED_BY(mutex_);
  std::map<scheduler::JobId, ledger::JobRecord> active_jobs_ ABSL_GUARDED_BY(mutex_);
  int64_t next_worker_ ABSL_GUARDED_BY(mutex_) = 1;
  std::map<scheduler::WorkerId, ConnectedWorker> workers_ ABSL_GUARDED_BY(mutex_);
  std::deque<MergedFrame> merged_frames_ ABSL_GUARDED_BY(mutex_);
  std::map<JobWatcher*, scheduler::JobId> watchers_ ABSL_GUARDED_BY(mutex_);
  std::set<scheduler::JobId> changed_jobs_ ABSL_GUARDED_BY(mutex_);
  absl::Time watchers_told_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  absl::CondVar chores_;

  std::unique_ptr<Committer> committer_;
  std::thread finisher_thread_;
  std::thread housekeeping_thread_;
};

}  // namespace lumifold::server
