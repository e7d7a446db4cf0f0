#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/baselines/baseline.h"
#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "worker/render/renderer.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// What a method made of a scene, and what it took beside time.
struct RenderedPicture {
  std::array<Plane, 3> picture;  // R G B, linear radiance, finite
  uint64_t camera_paths = 0;     // samples that began at the camera
  uint64_t gather_paths = 0;     // samples that began on a surface, to find the irradiance there
  uint64_t records = 0;          // what is kept in the scene: cached irradiances; 0 for methods of the image
};

/// A method that ours is compared with and that no filter of a finished film can stand for, since it changes
/// what is sampled or how light is gathered. Its function renders frame 0 with about `samples_per_pixel`
/// camera samples a pixel (at least 1; how they are spread is the method's own business) and one value for
/// each parameter, in their order and within their limits. The bits are the same for any pool (null: this
/// thread alone). Errors: those of Renderer::Create.
struct RenderMethod {
  std::string name;
  std::string summary;  // one line
  std::string source;   // whose method it is, and what here is not as published
  std::vector<filter::BaselineParameter> parameters;
  absl::StatusOr<RenderedPicture> (*render)(std::shared_ptr<const scene::Scene> scene,
                                            const RenderSettings& settings, uint32_t samples_per_pixel,
                                            absl::Span<const float> values, TaskPool* pool) = nullptr;
};

/// All of them, in the order tables list them.
const std::vector<RenderMethod>& RenderMethods();

/// Null where none has the name.
const RenderMethod* FindRenderMethod(std::string_view name);

}  // namespace lumifold::render
