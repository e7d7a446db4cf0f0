#pragma once

#include <atomic>

#include "filter/image/edged_image.h"
#include "filter/image/rect.h"
#include "worker/render/camera.h"
#include "worker/render/path_tracer.h"

namespace lumifold::render {

/// Traces fixed sub-pixel rays through every pixel of `rect`, a part of `frame` (the frame's bounds): four in
/// each pixel, and twelve more, which complete a 4x4 grid, in each edge pixel. The first four rays of a pixel
/// and of its eight neighbours in the frame decide whether it is an edge pixel (see IsEdgeBetween), so the
/// result does not depend on tiles.
/// Shapes: pixels: rect's size; N.X N.Y N.Z (unit mean over hits), Z, distance.Z, roughness.Y (means over
///         hits), id.Y (the most frequent one), mask.Y and A (fractions of the sub-samples); all 0 if nothing
///         is hit. For each level that any sub-sample reaches, layers::kLevelFeatures in the same way.
///         edges: see EdgedImage.
/// Once `stop`, which may be null, is true it returns within a row of pixels; the result is then incomplete.
EdgedImage RenderGeometryUnit(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame,
                              const Rect& rect, const std::atomic<bool>* stop = nullptr);

}  // namespace lumifold::render
