#pragma once

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/coordinator/options.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"
#include "server/metrics/farm_metrics.h"

namespace lumifold::cluster {
class MemberHost;
}  // namespace lumifold::cluster

namespace lumifold::server {

class Cleanup;
class CommitResults;
class Committer;
class FarmRecords;
class FarmState;
class FrameFinishing;
class Housekeeping;
class JobChanges;
class JobLoader;
class JobQueries;
class OperatorCalls;
class Submission;
class Takeover;
class WorkerCalls;

/// Makes all decisions about jobs: accepts them, grants leases, commits each unit once, finishes frames, ends
/// jobs. Independent of gRPC. Acknowledges a unit only after it is committed; after a restart with the same
/// data folder it continues all unfinished jobs.
///
/// This class only builds, starts and stops the parts. State and decisions are in Farm, behind the lock of
/// FarmState; a part for each kind of caller, and one for each thread, works on it.
/// Threads: safe; it has several of its own (committer, finisher, housekeeping, and those for tasks).
class Coordinator {
 public:
  /// Restores the unfinished jobs from the ledger. The caller has claimed the folder. `folder`, `store`,
  /// `assets` and `finisher` must outlive it.
  static absl::StatusOr<std::unique_ptr<Coordinator>> Create(const CoordinatorOptions& options,
                                                             const DataFolder& folder,
                                                             ledger::JobStore* store, AssetStore* assets,
                                                             FrameFinisher* finisher);
  ~Coordinator();
  /// From now on no lease is granted, and workers that disconnect do not count as lost with their units.
  void StopLeasing();
  /// Commits the accepted units and stops the threads. Later calls are safe, but no lease is granted any
  /// more.
  void Shutdown();

  SubmissionApi& submissions();
  JobApi& jobs();
  JobChangeApi& changes();
  OperatorApi& operators();
  WorkerApi& workers();
  /// What it does as one of several.
  cluster::MemberHost& member();

  /// Where others reach it, for display.
  void SetAddress(const std::string& address);
  /// The epoch that a job belongs to. Errors: those of JobStore::GetJob.
  absl::StatusOr<ledger::Epoch> OwnerOf(const job::JobId& job);
  /// Committed units of a job, for previews of one of its frames. Errors: those of GetPreview about the job
  /// and the frame.
  absl::StatusOr<int64_t> CountUnits(const job::JobId& job, int32_t frame);
  /// What the metrics endpoint shows. Linear in active jobs and workers.
  monitoring::FarmMetrics Metrics();
  /// Owner, storage, timings, traffic.
  Resources& resources() { return resources_; }

 private:
  Coordinator(const CoordinatorOptions& options, const DataFolder& folder, ledger::JobStore* store,
              AssetStore* assets, FrameFinisher* finisher, ledger::Owner owner);
  absl::Status RestoreJobs();
  absl::Status RestoreJob(const ledger::JobRecord& record);

  Resources resources_;
  // In the order in which they use those before.
  std::unique_ptr<Cleanup> cleanup_;
  std::unique_ptr<FarmRecords> records_;
  std::unique_ptr<FarmState> state_;
  std::unique_ptr<CommitResults> commit_results_;
  std::unique_ptr<Committer> committer_;
  std::unique_ptr<JobLoader> loader_;
  std::unique_ptr<JobQueries> queries_;
  std::unique_ptr<Submission> submission_;
  std::unique_ptr<OperatorCalls> operators_;
  std::unique_ptr<FrameFinishing> finishing_;
  std::unique_ptr<WorkerCalls> workers_;
  std::unique_ptr<JobChanges> changes_;
  std::unique_ptr<Takeover> takeover_;
  std::unique_ptr<Housekeeping> housekeeping_;
};

}  // namespace lumifold::server
