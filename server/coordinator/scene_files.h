#pragma once

#include <functional>
#include <string>

#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"

namespace lumifold::server {

/// What workers fetch of a job, and what happens when a file of its scene turns out to be lost or damaged.
/// Threads: safe.
class SceneFiles {
 public:
  /// Both must outlive it.
  SceneFiles(const Resources* resources, FarmState* state) : resources_(resources), state_(state) {}

  // See WorkerApi.
  absl::StatusOr<v1::JobSpec> FetchSpec(const v1::FetchSpecRequest& request, const std::string& caller) const;
  absl::Status CheckFetch(const v1::FetchAssetRequest& request, const std::string& caller) const;
  absl::StatusOr<rpc::ByteSender> OpenAsset(const v1::FetchAssetRequest& request) const;
  /// A worker could not get an asset of a unit that it holds. The content is read again, on another thread:
  /// it may have changed since it was checked. Calls `on_present` if the fault is not the file's; otherwise
  /// the job waits for it.
  void OnMissing(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                 const std::string& sha256, const std::function<void()>& on_present) const;

 private:
  void AwaitAsset(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                  const v1::AssetRef& asset) const;

  const Resources* const resources_;
  FarmState* const state_;
};

}  // namespace lumifold::server
