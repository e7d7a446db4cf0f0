#pragma once

#include <optional>

#include "absl/functional/function_ref.h"
#include "tests/charts/methods/rendering/camera_frame.h"
#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// The indirect irradiance at a surface hit by a sample of pixel (x, y); nothing if it is not known.
using IrradianceLookup =
    absl::FunctionRef<std::optional<scene::Vec3>(const render::Surface& surface, int x, int y)>;

/// Renders like the path tracer, except for I of first surfaces: that is the looked-up irradiance divided by
/// pi, as for a Lambertian lobe, or the estimate of one path if the lookup has none. Adds to the counts of
/// *out. The lookup must be safe concurrently.
void RenderWithIrradiance(const CameraFrame& frame, uint32_t samples_per_pixel, IrradianceLookup irradiance,
                          TaskPool* pool, RenderedPicture* out);

}  // namespace lumifold::charts
