#include "client/submit_scene.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <set>
#include <vector>

#include "absl/strings/str_cat.h"

namespace lumifold::client {
namespace {

// 128 random bits: unique among all submissions.
std::string MakeRequestId() {
  std::random_device random;
  std::string id;
  for (int i = 0; i < 4; ++i) absl::StrAppend(&id, absl::Hex(random(), absl::kZeroPad8));
  return id;
}

std::vector<const LocalAsset*> Missing(const SceneAssets& assets,
                                       const std::vector<std::string>& missing_sha256) {
  std::set<std::string> wanted(missing_sha256.begin(), missing_sha256.end());
  std::vector<const LocalAsset*> missing;
  for (const LocalAsset& asset : assets) {
    if (wanted.erase(asset.ref.sha256()) > 0) missing.push_back(&asset);
  }
  return missing;
}

absl::Status Upload(FarmClient& farm, const std::vector<const LocalAsset*>& assets, Progress& progress) {
  ProgressState state;
  state.stage = "uploading";
  state.unit = ProgressUnit::kBytes;
  for (const LocalAsset* asset : assets) state.total += static_cast<int64_t>(asset->ref.size());
  int64_t before = 0;
  for (const LocalAsset* asset : assets) {
    const absl::Status status = farm.UploadAsset(*asset, [&](uint64_t sent_bytes) {
      state.done = before + static_cast<int64_t>(sent_bytes);
      progress.Update(state);
    });
    if (!status.ok()) return {status.code(), absl::StrCat("sending ", asset->path, ": ", status.message())};
    before += static_cast<int64_t>(asset->ref.size());
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::string> SubmitScene(FarmClient& farm, const SceneAssets& assets, v1::JobSpec spec,
                                        Progress& progress) {
  *spec.mutable_scene() = MakeSceneRef(assets);
  const absl::StatusOr<std::vector<std::string>> missing = farm.FindMissingAssets(spec.scene());
  if (!missing.ok()) return missing.status();
  const absl::Status uploaded = Upload(farm, Missing(assets, *missing), progress);
  progress.Clear();
  if (!uploaded.ok()) return uploaded;
  return farm.SubmitJob(spec, MakeRequestId());
}

}  // namespace lumifold::client
