#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/baselines/method_info.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "worker/render/renderer.h"
#include "worker/scene/scene.h"

namespace lumifold::charts {

/// The picture a method rendered, and its cost besides time.
struct RenderedPicture {
  Picture picture;            // linear radiance, finite
  uint64_t camera_paths = 0;  // paths that began at the camera
  uint64_t gather_paths = 0;  // paths that began on a surface, to estimate the irradiance there
  uint64_t records = 0;       // irradiance records kept in the scene; 0 for image-space methods
};

/// A method that ours is compared with and that renders the scene itself, because it changes which samples
/// are taken or how light is gathered.
struct RenderMethod {
  filter::MethodInfo info;
  /// Renders frame 0 with about `samples_per_pixel` camera samples per pixel, at least 1; the method decides
  /// how they are distributed. `values`: one for each parameter, in their order and within their ranges. The
  /// bits are the same for any pool (null: this thread alone). Errors: those of render::Renderer::Create.
  absl::StatusOr<RenderedPicture> (*render)(std::shared_ptr<const scene::Scene> scene,
                                            const render::RenderSettings& settings,
                                            uint32_t samples_per_pixel, absl::Span<const float> values,
                                            TaskPool* pool) = nullptr;
};

/// All of them, in the order tables list them.
const std::vector<RenderMethod>& RenderMethods();

/// Null if no method has the name.
const RenderMethod* FindRenderMethod(std::string_view name);

}  // namespace lumifold::charts
