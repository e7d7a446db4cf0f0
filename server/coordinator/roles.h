#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/rect.h"
#include "filter/image/tile_samples.h"
#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/log.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/byte_stream.h"
#include "server/commit/unit_sender.h"
#include "server/film/unit_layout.h"
#include "server/film/unit_record.h"
#include "server/job/ids.h"
#include "server/job/unit.h"
#include "server/scheduler/types.h"

namespace lumifold::access {
struct Identity;
}  // namespace lumifold::access

/// What services ask of a coordinator, an interface for each kind of caller: farm.proto and worker.proto
/// document the calls and their errors. All are safe from any thread.
namespace lumifold::server {

class AssetUpload;

/// Is called once with the outcome, at once or from another thread, without a lock.
using StatusAnswer = std::function<void(absl::StatusOr<v1::JobStatus>)>;

/// Receives the status of a job. Its calls only queue: they never block and never call back.
class JobWatcher {
 public:
  virtual ~JobWatcher() = default;
  virtual void OnStatus(const v1::JobStatus& status) = 0;
  /// The job is no longer this coordinator's: nothing follows. kUnavailable where another one may know it.
  virtual void OnLost(const absl::Status& cause) = 0;
};

/// New jobs and the files of their scenes.
class SubmissionApi {
 public:
  virtual ~SubmissionApi() = default;
  virtual absl::StatusOr<v1::FindMissingAssetsResponse> FindMissingAssets(
      const v1::FindMissingAssetsRequest& request) const = 0;
  virtual absl::StatusOr<v1::FindUploadResponse> FindUpload(const v1::FindUploadRequest& request) const = 0;
  /// `caller` is whose upload it is, see AssetLimits::uploads.
  virtual absl::StatusOr<std::unique_ptr<AssetUpload>> ReceiveAsset(const v1::AssetRef& asset,
                                                                    const std::string& caller) = 0;
  /// Notes an error of the storage that an upload met, and returns what the caller is told.
  virtual absl::Status NoteError(const absl::Status& status) = 0;
  /// An asset was uploaded: jobs that wait for it go on.
  virtual void OnAssetStored(const std::string& sha256) = 0;
  virtual absl::StatusOr<v1::SubmitJobResponse> SubmitJob(const v1::SubmitJobRequest& request) = 0;
};

/// Jobs as they are.
class JobApi {
 public:
  virtual ~JobApi() = default;
  virtual absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id) = 0;
  /// Whose job it is. Errors: those of GetJob.
  virtual absl::StatusOr<std::string> UserOf(const std::string& job_id) = 0;
  virtual absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request) = 0;
  virtual absl::StatusOr<v1::ExplainJobResponse> ExplainJob(const std::string& job_id) = 0;
  virtual absl::StatusOr<rpc::ByteSender> OpenResult(const v1::DownloadResultRequest& request) = 0;
  /// Calls `watcher` with the job's status at once and after changes, at most ten times a second and once
  /// more when the job ends or is lost, until Unwatch.
  virtual absl::Status Watch(const std::string& job_id, JobWatcher* watcher) = 0;
  /// After it returns the watcher is not called again. No effect on a watcher that does not watch.
  virtual void Unwatch(JobWatcher* watcher) = 0;
  virtual absl::StatusOr<v1::ServerStatus> GetServerStatus() = 0;
  virtual absl::StatusOr<v1::GetUsageResponse> GetUsage(const v1::GetUsageRequest& request) = 0;
  virtual absl::StatusOr<v1::GetLogResponse> GetLog(const v1::GetLogRequest& request) = 0;
};

/// Changes of jobs that exist. The changes of all jobs are made one after the other.
class JobChangeApi {
 public:
  virtual ~JobChangeApi() = default;
  /// `done` has the status once the end of the job is recorded, or kResourceExhausted when it cannot be
  /// recorded now; then the job ends as soon as it can.
  virtual void CancelJob(const std::string& job_id, StatusAnswer done) = 0;
  virtual void RetryJob(const v1::RetryJobRequest& request, StatusAnswer done) = 0;
  virtual void AddSamples(const v1::AddSamplesRequest& request, StatusAnswer done) = 0;
  /// The answer is the status that the job had last.
  virtual void DeleteJob(const v1::DeleteJobRequest& request, StatusAnswer done) = 0;
};

/// How jobs are scheduled, and which workers are. What changes is recorded, so that it holds after a restart.
class OperatorApi {
 public:
  virtual ~OperatorApi() = default;
  virtual absl::StatusOr<v1::JobStatus> PauseJob(const std::string& job_id) = 0;
  virtual absl::StatusOr<v1::JobStatus> ResumeJob(const std::string& job_id) = 0;
  virtual absl::StatusOr<v1::JobStatus> SetJobPriority(const v1::SetJobPriorityRequest& request) = 0;
  virtual absl::StatusOr<v1::ListWorkersResponse> ListWorkers(const v1::ListWorkersRequest& request) = 0;
  virtual absl::StatusOr<v1::WorkerStatus> DrainWorker(const v1::WorkerRequest& request) = 0;
  virtual absl::StatusOr<v1::WorkerStatus> BlockWorker(const v1::WorkerRequest& request) = 0;
  virtual absl::StatusOr<v1::WorkerStatus> ReadmitWorker(const v1::WorkerRequest& request) = 0;
};

/// Queue of messages to a worker. Send never blocks and never calls back.
class WorkerSink {
 public:
  virtual ~WorkerSink() = default;
  virtual void Send(const v1::CoordinatorMessage& message) = 0;
};

/// A result that a worker delivers. Its destruction drops what has arrived, unless Finish has succeeded.
/// Threads: one at a time.
class ResultUpload {
 public:
  virtual ~ResultUpload() = default;
  /// Errors: those of rpc::ByteReceiver::Add; kInvalidArgument for a file that is too large.
  virtual absl::Status Add(const v1::ByteChunk& chunk) = 0;
  /// All has arrived: the frame is finished by it, once. Errors: kFailedPrecondition where something is
  /// missing; kDataLoss where the SHA-256 does not match; kAborted where the lease is void, or the job
  /// another coordinator's.
  virtual absl::Status Finish() = 0;
};

/// What a worker has to deliver for a lease.
struct LeasedUnit {
  Rect rect;
  TileSamples samples;
  film::UnitModel model;
};

/// A unit that its worker has rendered and keeps, see v1::KeptUnit.
struct KeptUnit {
  job::UnitRef unit;
  job::Attempt attempt;
  v1::UnitStats stats;
  uint64_t record_bytes = 0;
};

/// What a worker's connection says. `caller` is the identity of the connection, see access::KeyOf: a worker's
/// id is of use to its own identity only.
class WorkerApi {
 public:
  virtual ~WorkerApi() = default;
  /// Sends Welcome to a worker and grants it leases. With access control its name is that of its certificate,
  /// so that a block holds for all processes that have it, and they count as one party in audits. `sink` is
  /// used until RemoveWorker has returned.
  virtual absl::StatusOr<job::WorkerId> AddWorker(const v1::Hello& hello, const access::Identity& caller,
                                                  WorkerSink* sink) = 0;
  virtual void RemoveWorker(job::WorkerId worker) = 0;
  virtual void OnHeartbeat(job::WorkerId worker, const v1::Heartbeat& heartbeat) = 0;
  /// Keeps lines that the worker has sent of its log, for GetLog.
  virtual void KeepLog(job::WorkerId worker,
                       const google::protobuf::RepeatedPtrField<v1::LogEvent>& lines) = 0;
  /// The worker wants no more leases; answers with Released.
  virtual void OnLeaving(job::WorkerId worker, const std::string& reason) = 0;
  /// `reason`: empty where the worker takes leases again.
  virtual void OnRest(job::WorkerId worker, const std::string& reason) = 0;

  /// The unit of a lease that the worker holds; nullopt if it does not hold it.
  virtual std::optional<LeasedUnit> FindLease(job::WorkerId worker, const job::UnitRef& unit,
                                              job::Attempt attempt) = 0;
  /// Accepts a complete unit whose layout and values are valid.
  virtual void Deliver(job::WorkerId worker, film::EncodedUnit unit) = 0;
  /// Accepts a unit of a frame that the worker keeps.
  virtual void Keep(job::WorkerId worker, const KeptUnit& kept) = 0;
  /// Accepts the result of a plan unit that the worker holds, and commits it: only then is the job divided
  /// into the units of its frames. Errors: those of job::PlannedSpec.
  virtual absl::Status DeliverPlan(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                                   const v1::Plan& plan) = 0;
  /// Acknowledges a unit that is not wanted, so that the worker drops it.
  virtual void Dismiss(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) = 0;
  /// Fails a delivered unit that is not valid, and tells the worker the reason.
  virtual void RefuseUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                          const std::string& reason) = 0;
  virtual void FailUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                        const scheduler::UnitFailure& failure) = 0;
  /// The worker will not deliver these units.
  virtual void HandBack(job::WorkerId worker, const v1::HandBack& message) = 0;

  virtual absl::StatusOr<v1::JobSpec> FetchSpec(const v1::FetchSpecRequest& request,
                                                const std::string& caller) = 0;
  /// Whether the worker may read the asset.
  virtual absl::Status CheckFetch(const v1::FetchAssetRequest& request, const std::string& caller) = 0;
  /// After CheckFetch.
  virtual absl::StatusOr<rpc::ByteSender> OpenAsset(const v1::FetchAssetRequest& request) const = 0;
  /// The units of a frame that the worker has a lease to finish. Errors: kNotFound for a job that is not
  /// active; kPermissionDenied without such a lease; those of CommittedUnits.
  virtual absl::StatusOr<UnitSender> OpenUnits(const v1::FetchUnitsRequest& request,
                                               const std::string& caller) = 0;
  /// The result of such a lease is about to arrive. Errors: as OpenUnits; kResourceExhausted while the
  /// storage cannot be written.
  virtual absl::StatusOr<std::unique_ptr<ResultUpload>> ReceiveResult(
      const v1::ResultAnnouncement& announcement, const std::string& caller) = 0;
  /// The worker could not get an asset of the unit's job. If it is not here or damaged, the job waits until
  /// it is uploaded again; otherwise the unit has failed.
  virtual void OnAssetMissing(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                              const std::string& sha256, const std::string& error) = 0;
};

}  // namespace lumifold::server
