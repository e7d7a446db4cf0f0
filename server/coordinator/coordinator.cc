#include "server/coordinator/coordinator.h"

#include <spdlog/logger.h>
#include <unistd.h>

#include <array>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/logging/fields.h"
#include "server/assets/asset_store.h"
#include "server/commit/committer.h"
#include "server/coordinator/cleanup.h"
#include "server/coordinator/commit_results.h"
#include "server/coordinator/farm_records.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/frame_finishing.h"
#include "server/coordinator/housekeeping.h"
#include "server/coordinator/job_changes.h"
#include "server/coordinator/job_loader.h"
#include "server/coordinator/job_queries.h"
#include "server/coordinator/metrics.h"
#include "server/coordinator/operator_calls.h"
#include "server/coordinator/submission.h"
#include "server/coordinator/takeover.h"
#include "server/coordinator/worker_calls.h"
#include "server/finish/frame_finisher.h"

namespace lumifold::server {

using job::JobId;

namespace {

/// Host, process and a random number.
std::string OwnerName(uint64_t random) {
  std::array<char, 256> host = {};
  if (gethostname(host.data(), host.size() - 1) != 0) host = {'?'};
  return absl::StrFormat("%s:%d:%016x", host.data(), getpid(), random);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Coordinator>> Coordinator::Create(const CoordinatorOptions& options,
                                                                 const DataFolder& folder,
                                                                 ledger::JobStore* store, AssetStore* assets,
                                                                 FrameFinisher* finisher) {
  const absl::StatusOr<ledger::Epoch> epoch = store->NewEpoch();
  if (!epoch.ok()) return epoch.status();
  std::unique_ptr<Coordinator> coordinator(new Coordinator(
      options, options.is_member ? folder.WithLogsOf(absl::StrCat("e", epoch->value())) : folder, store,
      assets, finisher, {OwnerName(options.random()), *epoch}));
  absl::StatusOr<std::unique_ptr<webhooks::Webhooks>> webhooks =
      webhooks::Webhooks::Open(options.webhooks, {.secret_path = folder.PathOf("webhook.secret"),
                                                  .queue = &store->deliveries(),
                                                  .wall_now = options.wall_now,
                                                  .random = options.random,
                                                  .log = options.log});
  if (!webhooks.ok()) return webhooks.status();
  coordinator->resources_.webhooks = *std::move(webhooks);
  if (absl::Status status = coordinator->operators_->ReadBlockedWorkers(); !status.ok()) return status;
  if (!options.is_member) {
    if (absl::Status status = coordinator->RestoreJobs(); !status.ok()) return status;
  }
  assets->SetRoom([self = coordinator.get()] { return self->cleanup_->janitor().Room(); });
  coordinator->committer_->Start();
  coordinator->cleanup_->janitor().Start();
  coordinator->finishing_->Start();
  coordinator->housekeeping_->Start();
  coordinator->resources_.webhooks->Start();
  return coordinator;
}

Coordinator::Coordinator(const CoordinatorOptions& options, const DataFolder& folder, ledger::JobStore* store,
                         AssetStore* assets, FrameFinisher* finisher, ledger::Owner owner)
    : resources_(options, folder, store, assets, finisher, std::move(owner)),
      cleanup_(std::make_unique<Cleanup>(&resources_)),
      records_(std::make_unique<FarmRecords>(&resources_, cleanup_.get())),
      state_(std::make_unique<FarmState>(&resources_, records_.get())),
      commit_results_(std::make_unique<CommitResults>(&resources_, state_.get())),
      committer_(std::make_unique<Committer>(
          CommitterOptions{.epoch = resources_.owner.epoch, .now = options.now, .storage = options.storage},
          resources_.folder, store, &resources_.storage, &resources_.timings, commit_results_.get())),
      loader_(std::make_unique<JobLoader>(&resources_, state_.get(), cleanup_.get())),
      queries_(std::make_unique<JobQueries>(&resources_, state_.get())),
      submission_(
          std::make_unique<Submission>(&resources_, state_.get(), cleanup_.get(), &loader_->prerequisites())),
      operators_(
          std::make_unique<OperatorCalls>(&resources_, state_.get(), committer_.get(), queries_.get())),
      finishing_(std::make_unique<FrameFinishing>(&resources_, state_.get(), committer_.get(), cleanup_.get(),
                                                  &records_->finishing())),
      workers_(std::make_unique<WorkerCalls>(&resources_, state_.get(), committer_.get(), finishing_.get())),
      changes_(std::make_unique<JobChanges>(&resources_, state_.get(),
                                            JobChanges::Parts{.committer = committer_.get(),
                                                              .cleanup = cleanup_.get(),
                                                              .loader = loader_.get(),
                                                              .queries = queries_.get(),
                                                              .scheduling = &operators_->changes()})),
      takeover_(std::make_unique<Takeover>(&resources_, state_.get(),
                                           Takeover::Parts{.loader = loader_.get(),
                                                           .submission = submission_.get(),
                                                           .operators = operators_.get(),
                                                           .stop_leasing = [this] { StopLeasing(); }})),
      housekeeping_(std::make_unique<Housekeeping>(&resources_, state_.get(), cleanup_.get(),
                                                   &records_->housekeeping())) {
  records_->Connect(state_.get(), committer_.get(), changes_.get());
}

Coordinator::~Coordinator() { Shutdown(); }

SubmissionApi& Coordinator::submissions() { return *submission_; }
JobApi& Coordinator::jobs() { return *queries_; }
JobChangeApi& Coordinator::changes() { return *changes_; }
OperatorApi& Coordinator::operators() { return *operators_; }
WorkerApi& Coordinator::workers() { return *workers_; }
cluster::MemberHost& Coordinator::member() { return *takeover_; }

absl::Status Coordinator::RestoreJobs() {
  const absl::StatusOr<ledger::ClaimedJobs> claimed = resources_.store->ClaimUnfinishedJobs(resources_.owner);
  if (!claimed.ok()) return claimed.status();
  for (const ledger::DamagedJob& job : claimed->damaged) {
    // Its film stays, so that `lumifold-server recover` can save it.
    resources_.log().error("event=job_damaged job={} error={}", job.id.value(),
                           logging::Quoted(job.error.message()));
  }
  for (const ledger::JobRecord& record : claimed->jobs) {
    if (absl::Status status = RestoreJob(record); !status.ok()) return status;
  }
  const absl::StatusOr<std::vector<ledger::JobRecord>> forgotten = loader_->FindForgottenJobs();
  if (!forgotten.ok()) return forgotten.status();
  for (const ledger::JobRecord& record : *forgotten) {
    resources_.log().warn(
        "event=job_adopted job={} reason=\"its manifest is here, but not its row in the ledger\"",
        record.id.value());
    if (absl::Status status = RestoreJob(record); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status Coordinator::RestoreJob(const ledger::JobRecord& record) {
  const absl::StatusOr<LoadedJob> loaded = loader_->Load(record);
  if (!loaded.ok()) return loaded.status();
  for (const auto& [frame, bytes] : loaded->committed_bytes)
    committer_->RestoreLog({record.id, frame}, bytes);
  FarmState::Change(state_.get())->EnterJob(*loaded);
  return absl::OkStatus();
}

void Coordinator::StopLeasing() {
  std::vector<JobId> ending;
  {
    FarmState::Change farm(state_.get());
    if (farm->is_leasing()) farm->phase = Farm::Phase::kDraining;
    ending = farm->jobs.Ending();
  }
  for (const JobId& job : ending) {
    records_->AnswerCancels(
        job, absl::UnavailableError("the coordinator is stopping; the job is not yet cancelled"));
  }
  changes_->StopAnswering();
}

void Coordinator::Shutdown() {
  StopLeasing();
  FarmState::Change(state_.get())->phase = Farm::Phase::kStopping;
  records_->WakeHousekeeping();
  records_->WakeFinisher();
  resources_.finisher->Cancel();
  finishing_->Join();
  committer_->Stop();
  housekeeping_->Join();
  changes_->Stop();
  takeover_->Stop();
  if (resources_.webhooks != nullptr) resources_.webhooks->Stop();
  cleanup_->Stop();
}

void Coordinator::SetAddress(const std::string& address) {
  FarmState::Change(state_.get())->address = address;
}

absl::StatusOr<ledger::Epoch> Coordinator::OwnerOf(const JobId& job) { return queries_->OwnerOf(job); }

absl::StatusOr<int64_t> Coordinator::CountUnits(const JobId& job, int32_t frame) {
  return queries_->CountUnits(job, frame);
}

monitoring::FarmMetrics Coordinator::Metrics() { return MetricsOf(resources_, state_.get()); }

}  // namespace lumifold::server
