#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/scene.pb.h"
#include "worker/cache/asset_source.h"
#include "worker/render/renderer.h"
#include "worker/scene/scene.h"
#include "worker/units/decoded_cache.h"

namespace lumifold::worker {

/// Returns the content of a job's file.
using FetchAsset = absl::FunctionRef<absl::StatusOr<AssetContent>(const v1::AssetRef&)>;

/// A job's scene in one frame, and what the job asks of the renderer.
struct JobScene {
  std::shared_ptr<const scene::Scene> scene;
  render::RenderSettings settings;
  bool in_studio = false;  // the scene has no light: settings.environment is render::StudioEnvironment()
};

/// Loads the scene and the environment of a job, or lights the scene by a studio; `pool` decodes
/// textures, makes their mip levels and, once the renderer is created, builds its acceleration structure.
/// `progress` grows by one for each file.
/// Errors: those of `fetch`, scene::LoadGltf and render::Environment::Create; kNotFound for a file that is
/// not among the job's.
absl::StatusOr<JobScene> LoadJobScene(const v1::JobSpec& spec, int frame, FetchAsset fetch,
                                      DecodedCache* decoded, TaskPool* pool, std::atomic<int64_t>* progress);

/// Whether LoadJobScene and the renderer would take the scene in this frame, without its pictures, whose
/// decoding takes longest. Errors: those of scene::LoadGltf and render::MakeCamera; of `fetch`.
absl::Status CheckJobScene(const v1::JobSpec& spec, int frame, FetchAsset fetch, TaskPool* pool);

/// `status` with the name of the job's scene before its message.
absl::Status NamingScene(const absl::Status& status, const v1::JobSpec& spec);

}  // namespace lumifold::worker
