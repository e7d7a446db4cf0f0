#include "client/farm/submit_scene.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/farm/upload.h"

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

absl::Status Upload(FarmClient& farm, const std::vector<const LocalAsset*>& assets, Progress& progress,
                    const Backoff& backoff) {
  ProgressState state;
  state.stage = "uploading";
  state.unit = ProgressUnit::kBytes;
  for (const LocalAsset* asset : assets) state.total += static_cast<int64_t>(asset->ref.size());
  int64_t before = 0;
  for (const LocalAsset* asset : assets) {
    const absl::Status status = UploadFile(farm, *asset, progress, backoff, [&](uint64_t sent_bytes) {
      state.done = before + static_cast<int64_t>(sent_bytes);
      progress.Update(state);
    });
    if (!status.ok()) return {status.code(), absl::StrCat("sending ", asset->path, ": ", status.message())};
    before += static_cast<int64_t>(asset->ref.size());
  }
  return absl::OkStatus();
}

// The request id makes retries harmless.
absl::StatusOr<std::string> Submit(FarmClient& farm, v1::SubmitJobRequest job, Backoff backoff) {
  job.set_request_id(MakeRequestId());
  backoff.Reset();
  while (true) {
    absl::StatusOr<std::string> job_id = farm.SubmitJob(job);
    if (!absl::IsUnavailable(job_id.status()) || !backoff.Pause()) return job_id;
  }
}

}  // namespace

absl::StatusOr<std::string> SubmitScene(FarmClient& farm, const SceneAssets& assets, v1::SubmitJobRequest job,
                                        Progress& progress, const Backoff& backoff) {
  v1::SceneRef* scene = job.mutable_spec()->mutable_scene();
  *scene = MakeSceneRef(assets);
  const absl::StatusOr<std::vector<std::string>> missing = farm.FindMissingAssets(*scene);
  if (!missing.ok()) return missing.status();
  const absl::Status uploaded = Upload(farm, Missing(assets, *missing), progress, backoff);
  progress.Clear();
  if (!uploaded.ok()) return uploaded;
  return Submit(farm, std::move(job), backoff);
}

}  // namespace lumifold::client
