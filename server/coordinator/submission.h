#pragma once

#include <memory>
#include <string>
#include <vector>

#include "server/coordinator/cleanup.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/prerequisites.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"

namespace lumifold::server {

/// How a job gets into the ledger, and from there into the farm.
/// Threads: safe.
class Submission final : public SubmissionApi {
 public:
  /// All must outlive it.
  Submission(Resources* resources, FarmState* state, Cleanup* cleanup, const Prerequisites* prerequisites);

  absl::StatusOr<v1::FindMissingAssetsResponse> FindMissingAssets(
      const v1::FindMissingAssetsRequest& request) const override;
  absl::StatusOr<v1::FindUploadResponse> FindUpload(const v1::FindUploadRequest& request) const override;
  absl::StatusOr<std::unique_ptr<AssetUpload>> ReceiveAsset(const v1::AssetRef& asset,
                                                            const std::string& caller) override;
  absl::Status NoteError(const absl::Status& status) override { return resources_->NoteError(status); }
  void OnAssetStored(const std::string& sha256) override;
  absl::StatusOr<v1::SubmitJobResponse> SubmitJob(const v1::SubmitJobRequest& request) override;

  /// Starts the jobs of submissions whose clients may have got the answer elsewhere.
  void StartUncertainJobs();

 private:
  absl::Status CheckSpec(const v1::JobSpec& spec) const;
  /// That the files of a job are not too large together.
  absl::Status CheckAssetBytes(const v1::JobSpec& spec) const;
  /// Counts a submission of the user until its end. Errors: kResourceExhausted where it has too many jobs.
  absl::Status BeginSubmission(const std::string& user);
  /// Checks what a new job must meet, and records it.
  absl::StatusOr<job::JobId> SubmitNewJob(ledger::NewJob job);
  /// A request that is recorded: starts its job if an error of the storage has left open whether it is.
  /// Returns `id`.
  absl::StatusOr<job::JobId> StartIfUncertain(const job::JobId& id);
  absl::StatusOr<job::JobId> RecordJob(const ledger::NewJob& job,
                                       const std::vector<job::Prerequisite>& after);
  /// Starts a recorded job. `was_uncertain`: it is an uncertain one, unless another call was first.
  void StartJob(ledger::JobRecord record, const std::vector<job::Prerequisite>& after, bool was_uncertain);

  Resources* const resources_;
  FarmState* const state_;
  Cleanup* const cleanup_;
  const Prerequisites* const prerequisites_;
};

}  // namespace lumifold::server
