#pragma once

#include <optional>

#include "absl/functional/function_ref.h"
#include "tests/charts/methods/rendering/camera_frame.h"
#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// The indirect irradiance at a surface that a sample of pixel (x, y) met; none where it is not known.
using IrradianceLookup =
    absl::FunctionRef<std::optional<scene::Vec3>(const render::Surface& surface, int x, int y)>;

/// Renders as the path tracer does, all samples of all lobes, but for I of first surfaces: that is the
/// irradiance the lookup gives over pi, as of a Lambertian lobe, or one path's where it gives none. Adds to
/// the counts of *out. The lookup must be safe concurrently.
void RenderWithIrradiance(const CameraFrame& frame, uint32_t samples_per_pixel, IrradianceLookup irradiance,
                          TaskPool* pool, RenderedPicture* out);

}  // namespace lumifold::charts
