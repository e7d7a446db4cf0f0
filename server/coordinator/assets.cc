// What workers fetch of a job, and jobs that wait for a file of their scene, which was lost or damaged after they were
// submitted.
#include <spdlog/logger.h>

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/assets/asset_checks.h"
#include "server/coordinator/coordinator.h"

namespace lumifold::server {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

namespace {

/// The file of a scene with this content; null if it has none.
const v1::AssetRef* FindAsset(const v1::SceneRef& scene, const std::string& sha256) {
  if (scene.file().sha256() == sha256) return &scene.file();
  const auto found = std::find_if(scene.dependencies().begin(), scene.dependencies().end(),
                                  [&](const v1::AssetRef& asset) { return asset.sha256() == sha256; });
  return found == scene.dependencies().end() ? nullptr : &*found;
}

std::string NameOf(const v1::AssetRef& asset) {
  return asset.uri().empty() ? "the scene file" : absl::StrCat("'", asset.uri(), "'");
}

}  // namespace

absl::Status Coordinator::CheckHasLeases(const std::string& worker_id, const std::string& caller,
                                         const JobId& job) {
  if (!active_jobs_.contains(job))
    return absl::NotFoundError(absl::StrCat("no active job ", logging::Quoted(job.value())));
  const std::optional<WorkerId> worker = job::ParseWorkerId(worker_id);
  const auto connected = worker.has_value() ? workers_.find(*worker) : workers_.end();
  if (connected == workers_.end() || connected->second.caller != caller)
    return absl::PermissionDeniedError(
        absl::StrCat("no worker ", logging::Quoted(worker_id), " is connected"));
  if (!connected->second.known_jobs.contains(job)) {
    return absl::PermissionDeniedError(
        absl::StrCat("worker ", worker_id, " has no lease of job ", job.value()));
  }
  return absl::OkStatus();
}

absl::StatusOr<v1::JobSpec> Coordinator::FetchSpec(const v1::FetchSpecRequest& request,
                                                   const std::string& caller) {
  const JobId job(request.job_id());
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = CheckHasLeases(request.worker_id(), caller, job); !status.ok()) return status;
  return active_jobs_.at(job).spec;
}

absl::Status Coordinator::CheckFetch(const v1::FetchAssetRequest& request, const std::string& caller) {
  const JobId job(request.job_id());
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = CheckHasLeases(request.worker_id(), caller, job); !status.ok()) return status;
  // A scene may have thousands of files, and each worker fetches all of them.
  const auto [files, is_new] = scene_files_.try_emplace(job);
  if (is_new) {
    const v1::SceneRef& scene = active_jobs_.at(job).spec.scene();
    files->second.insert(scene.file().sha256());
    for (const v1::AssetRef& asset : scene.dependencies()) files->second.insert(asset.sha256());
  }
  if (files->second.contains(request.sha256())) return absl::OkStatus();
  return absl::PermissionDeniedError(
      absl::StrCat("job ", job.value(), " has no file ", logging::Quoted(request.sha256())));
}

absl::StatusOr<rpc::ByteSender> Coordinator::OpenAsset(const v1::FetchAssetRequest& request) const {
  return assets_->Open(request.sha256(), request.offset());
}

void Coordinator::OnAssetMissing(WorkerId worker, const UnitRef& unit, Attempt attempt,
                                 const std::string& sha256, const std::string& error) {
  v1::AssetRef asset;
  {
    absl::MutexLock lock(&mutex_);
    if (!scheduler_.HoldsLease(worker, unit, attempt)) return;
    const v1::AssetRef* found = FindAsset(active_jobs_.at(unit.job).spec.scene(), sha256);
    if (found != nullptr) asset = *found;
    if (wanted_assets_.contains(unit.job)) {  // another unit of the job found it out
      scheduler_.HandBack(worker, unit, attempt);
      return GrantLeases();
    }
  }
  if (asset.sha256().empty()) return FailUnit(worker, unit, attempt, error, /*permanent=*/false);
  // The content is read again, on another thread: it may have changed since it was checked.
  options_.asset_checks->Recheck(sha256,
                                 [this, worker, unit, attempt, asset, error](const absl::Status& checked) {
                                   if (!checked.ok()) return;  // the coordinator is stopping
                                   if (assets_->Has(asset.sha256()))
                                     return FailUnit(worker, unit, attempt, error, /*permanent=*/false);
                                   AwaitAsset(worker, unit, attempt, asset);
                                   if (assets_->Has(asset.sha256()))
                                     OnAssetStored(asset.sha256());  // it came just before
                                 });
}

void Coordinator::AwaitAsset(WorkerId worker, const UnitRef& unit, Attempt attempt,
                             const v1::AssetRef& asset) {
  absl::MutexLock lock(&mutex_);
  if (!active_jobs_.contains(unit.job)) return;
  scheduler_.PauseJob(unit.job);
  scheduler_.HandBack(worker, unit, attempt);
  if (wanted_assets_.emplace(unit.job, asset).second) {
    options_.log->error("event=asset_wanted job={} worker={} asset={} sha256={}", unit.job.value(),
                        NameOf(worker), logging::Quoted(server::NameOf(asset)), asset.sha256());
  }
  changed_jobs_.insert(unit.job);
  GrantLeases();
}

void Coordinator::OnAssetStored(const std::string& sha256) {
  absl::MutexLock lock(&mutex_);
  for (auto wanted = wanted_assets_.begin(); wanted != wanted_assets_.end();) {
    if (wanted->second.sha256() != sha256) {
      ++wanted;
      continue;
    }
    const JobId job = wanted->first;
    wanted = wanted_assets_.erase(wanted);
    options_.log->info("event=asset_found job={} sha256={}", job.value(), sha256);
    if (!active_jobs_.at(job).scheduling.paused()) scheduler_.ResumeJob(job);
    changed_jobs_.insert(job);
  }
  GrantLeases();
}

void Coordinator::ExplainAsset(const JobId& job, v1::ExplainJobResponse* response) {
  const auto wanted = wanted_assets_.find(job);
  if (wanted == wanted_assets_.end()) return;
  v1::Reason* reason = response->add_reasons();
  reason->set_code("asset");
  reason->set_text(absl::StrCat(server::NameOf(wanted->second), " (", wanted->second.sha256(),
                                ") is missing or damaged; submit the scene again to upload it"));
}

}  // namespace lumifold::server
