#include "client/local/scene_planner.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "worker/units/job_plan.h"
#include "worker/units/job_scene.h"

namespace lumifold::local {

absl::StatusOr<v1::Plan> PlanScene(const v1::JobSpec& spec, const client::SceneAssets& assets) {
  const auto fetch = [&](const v1::AssetRef& wanted) -> absl::StatusOr<std::string> {
    const auto asset = std::find_if(assets.begin(), assets.end(),
                                    [&](const client::LocalAsset& a) { return a.ref.uri() == wanted.uri(); });
    if (asset == assets.end())
      return absl::NotFoundError(absl::StrCat("'", wanted.uri(), "' is no file of the scene"));
    return client::ReadAsset(*asset);
  };
  worker::DecodedCache decoded;
  std::atomic<int64_t> progress = 0;
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(static_cast<int>(std::thread::hardware_concurrency()));
  const auto job = worker::LoadJobScene(spec, spec.first_frame(), fetch, &decoded, pool.get(), &progress);
  if (!job.ok()) return job.status();
  return worker::PlanJob(spec, *job);
}

}  // namespace lumifold::local
