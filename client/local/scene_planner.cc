#include "client/local/scene_planner.h"

#include <algorithm>
#include <atomic>
#include <string>

#include "absl/strings/str_cat.h"
#include "worker/job_scene.h"
#include "worker/plan/plan.h"
#include "worker/plan/plan_text.h"
#include "worker/plan/probe.h"

namespace lumifold::local {

absl::StatusOr<client::PlanTexts> PlanScene(const v1::JobSpec& spec, const client::SceneAssets& assets,
                                            const client::PlanOptions& options) {
  const auto fetch = [&](const v1::AssetRef& wanted) -> absl::StatusOr<std::string> {
    const auto asset = std::find_if(assets.begin(), assets.end(),
                                    [&](const client::LocalAsset& a) { return a.ref.uri() == wanted.uri(); });
    if (asset == assets.end())
      return absl::NotFoundError(absl::StrCat("'", wanted.uri(), "' is no file of the scene"));
    return client::ReadAsset(*asset);
  };
  worker::DecodedCache decoded;
  std::atomic<int64_t> progress = 0;
  const auto job = worker::LoadJobScene(spec, spec.first_frame(), fetch, &decoded, &progress);
  if (!job.ok()) return job.status();
  plan::PlanSettings settings;
  settings.render = job->settings;
  settings.samples = spec.samples_per_pixel();
  settings.full = options.full;
  settings.forced = options.forced;
  const absl::StatusOr<plan::Probe> probe = plan::RunProbe(*job->scene, settings.render);
  if (!probe.ok()) return worker::NamingScene(probe.status(), spec);
  const absl::StatusOr<plan::Plan> plan = plan::MakePlan(*job->scene, settings, *probe);
  if (!plan.ok()) return plan.status();
  return client::PlanTexts{plan::PlanTable(*plan), plan::PlanJson(*plan)};
}

}  // namespace lumifold::local
