#include "client/local/scene_planner.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/units/job_plan.h"
#include "worker/units/job_scene.h"

namespace lumifold::local {
namespace {

/// Larger scenes may not fit the machine of those who submit them.
constexpr uint64_t kMaxCheckedBytes = uint64_t{1} << 30;

/// The files of a scene on this machine.
class LocalFiles {
 public:
  explicit LocalFiles(const client::SceneAssets& assets) : assets_(assets) {}

  absl::StatusOr<worker::AssetContent> operator()(const v1::AssetRef& wanted) const {
    const auto asset = std::find_if(assets_.begin(), assets_.end(),
                                    [&](const client::LocalAsset& a) { return a.ref.uri() == wanted.uri(); });
    if (asset == assets_.end())
      return absl::NotFoundError(absl::StrCat("'", wanted.uri(), "' is no file of the scene"));
    absl::StatusOr<std::string> content = client::ReadAsset(*asset);
    if (!content.ok()) return content.status();
    return std::make_shared<const std::string>(*std::move(content));
  }

 private:
  const client::SceneAssets& assets_;
};

std::unique_ptr<TaskPool> AllThreads() {
  return MakeTaskPool(static_cast<int>(std::thread::hardware_concurrency()));
}

}  // namespace

absl::StatusOr<v1::Plan> PlanScene(const v1::JobSpec& spec, const client::SceneAssets& assets) {
  const LocalFiles files(assets);
  worker::DecodedCache decoded;
  std::atomic<int64_t> progress = 0;
  const std::unique_ptr<TaskPool> pool = AllThreads();
  const auto job = worker::LoadJobScene(spec, spec.first_frame(), files, &decoded, pool.get(), &progress);
  if (!job.ok()) return job.status();
  return worker::PlanJob(spec, *job);
}

absl::Status CheckScene(const v1::JobSpec& spec, const client::SceneAssets& assets) {
  uint64_t bytes = 0;
  for (const client::LocalAsset& asset : assets) bytes += asset.ref.size();
  if (bytes > kMaxCheckedBytes) return absl::OkStatus();
  const std::unique_ptr<TaskPool> pool = AllThreads();
  return worker::CheckJobScene(spec, spec.first_frame(), LocalFiles(assets), pool.get());
}

}  // namespace lumifold::local
