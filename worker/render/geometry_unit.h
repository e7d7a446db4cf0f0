#pragma once

#include "filter/image/edged_image.h"
#include "filter/image/rect.h"
#include "worker/render/camera.h"
#include "worker/render/path_tracer.h"

namespace lumifold::render {

/// Traces fixed sub-pixel rays through every pixel of `rect`, a part of `frame` (the frame's bounds): four,
/// and where an edge runs through the pixel or beside it twelve more, so that there is a 4x4 grid of them.
/// Whether a pixel is an edge pixel is decided by the first four rays of it and of its eight neighbours in
/// the frame, so that tiles make no difference.
/// Shapes: pixels: rect's size; N.X N.Y N.Z (unit mean over hits), Z, distance.Z, roughness.Y (means over
///         hits), id.Y (of most sub-pixels), mask.Y and A (shares of the sub-pixels); all 0 where nothing is
///         hit. Of each level that any sub-pixel reaches layers::kLevelFeatures in the same way.
///         edges: see EdgedImage.
EdgedImage RenderGeometryUnit(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame,
                              const Rect& rect);

}  // namespace lumifold::render
