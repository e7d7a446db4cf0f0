#include "server/coordinator/scene_files.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <optional>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/assets/asset_checks.h"
#include "server/assets/asset_store.h"
#include "server/coordinator/explain.h"
#include "server/job/job_spec.h"

namespace lumifold::server {
namespace {

using job::JobId;
using job::WorkerId;

/// The file of a scene with this content; null if it has none.
const v1::AssetRef* FindAsset(const v1::SceneRef& scene, const std::string& sha256) {
  if (scene.file().sha256() == sha256) return &scene.file();
  const auto found = std::find_if(scene.dependencies().begin(), scene.dependencies().end(),
                                  [&](const v1::AssetRef& asset) { return asset.sha256() == sha256; });
  return found == scene.dependencies().end() ? nullptr : &*found;
}

/// Whether a connected worker has had a lease of the active job.
absl::Status CheckHasLeases(const Farm& farm, const std::string& worker_id, const std::string& caller,
                            const JobId& job) {
  if (farm.jobs.FindActive(job) == nullptr)
    return absl::NotFoundError(absl::StrCat("no active job ", logging::Quoted(job.value())));
  const std::optional<WorkerId> worker = job::ParseWorkerId(worker_id);
  const ConnectedWorker* const connected = worker.has_value() ? farm.workers.Find(*worker) : nullptr;
  if (connected == nullptr || connected->caller != caller)
    return absl::PermissionDeniedError(
        absl::StrCat("no worker ", logging::Quoted(worker_id), " is connected"));
  if (!connected->known_jobs.contains(job)) {
    return absl::PermissionDeniedError(
        absl::StrCat("worker ", worker_id, " has no lease of job ", job.value()));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<v1::JobSpec> SceneFiles::FetchSpec(const v1::FetchSpecRequest& request,
                                                  const std::string& caller) const {
  const JobId job(request.job_id());
  FarmState::View farm(state_);
  if (absl::Status status = CheckHasLeases(*farm, request.worker_id(), caller, job); !status.ok())
    return status;
  return farm->jobs.FindActive(job)->record.spec;
}

absl::Status SceneFiles::CheckFetch(const v1::FetchAssetRequest& request, const std::string& caller) const {
  const JobId job(request.job_id());
  FarmState::Change farm(state_);
  if (absl::Status status = CheckHasLeases(*farm, request.worker_id(), caller, job); !status.ok())
    return status;
  // A scene may have thousands of files, and each worker fetches all of them.
  ActiveJob* const active = farm->jobs.FindActive(job);
  if (active->scene_files.empty()) active->scene_files = job::FilesOf(active->record.spec.scene());
  if (active->scene_files.contains(request.sha256())) return absl::OkStatus();
  return absl::PermissionDeniedError(
      absl::StrCat("job ", job.value(), " has no file ", logging::Quoted(request.sha256())));
}

absl::StatusOr<rpc::ByteSender> SceneFiles::OpenAsset(const v1::FetchAssetRequest& request) const {
  return resources_->assets->Open(request.sha256(), request.offset());
}

void SceneFiles::OnMissing(WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                           const std::string& sha256, const std::function<void()>& on_present) const {
  v1::AssetRef asset;
  {
    FarmState::Change farm(state_);
    if (!farm->scheduler.units().HoldsLease(worker, unit, attempt)) return;
    const ActiveJob* const active = farm->jobs.FindActive(unit.job);
    if (active->wanted_asset.has_value()) {  // another unit of the job found it out
      farm->scheduler.units().HandBack(worker, unit, attempt);
      return;
    }
    const v1::AssetRef* const found = FindAsset(active->record.spec.scene(), sha256);
    if (found != nullptr) asset = *found;
  }
  if (asset.sha256().empty()) return on_present();
  resources_->options.asset_checks->Recheck(
      sha256, [this, worker, unit, attempt, asset, on_present](const absl::Status& checked) {
        if (!checked.ok()) return;  // the coordinator is stopping
        if (resources_->assets->Has(asset.sha256())) return on_present();
        AwaitAsset(worker, unit, attempt, asset);
        // It may have come just before.
        if (resources_->assets->Has(asset.sha256())) FarmState::Change(state_)->OnAssetFound(asset.sha256());
      });
}

void SceneFiles::AwaitAsset(WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                            const v1::AssetRef& asset) const {
  FarmState::Change farm(state_);
  ActiveJob* const active = farm->jobs.FindActive(unit.job);
  if (active == nullptr) return;
  if (!active->wanted_asset.has_value()) {
    active->wanted_asset = asset;
    resources_->log().error("event=asset_wanted job={} worker={} asset={} sha256={}", unit.job.value(),
                            farm->workers.NameOf(worker), logging::Quoted(NameOfAsset(asset)),
                            asset.sha256());
  }
  farm->UpdatePause(unit.job);
  farm->scheduler.units().HandBack(worker, unit, attempt);
  farm->watchers.MarkChanged(unit.job);
}

}  // namespace lumifold::server
