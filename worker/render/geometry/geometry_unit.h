#pragma once

#include <atomic>

#include "filter/image/edged_image.h"
#include "filter/image/rect.h"
#include "worker/render/geometry/camera.h"
#include "worker/render/geometry/edge_mask.h"
#include "worker/render/tracing/path_tracer.h"

namespace lumifold::render {

/// The data of a geometry unit, and which of its pixels are edge pixels.
struct GeometryUnit {
  EdgedImage image;
  EdgeMask mask;
};

/// Traces fixed sub-pixel rays through every pixel of `rect`, a part of `frame` (the frame's bounds): four in
/// each pixel, and twelve more, which complete a 4x4 grid, in each edge pixel. The first four rays of a pixel
/// and of its eight neighbours in the frame decide whether it is an edge pixel (see IsEdgeBetween), so the
/// result does not depend on tiles.
/// Shapes: pixels: rect's size; N.X N.Y N.Z (unit mean over hits), Z, distance.Z, roughness.Y (means over
///         hits), id.Y (the most frequent one), mask.Y and A (fractions of the sub-samples); all 0 if nothing
///         is hit. For each level that any sub-sample reaches, layers::kLevelFeatures in the same way.
///         edges: see EdgedImage. mask: rect.
/// Where an edge pixel or one of its neighbours shows a surface brighter than white, in its first four rays,
/// albedo and emission of each sub-sample are means over 16 rays in its cell of the grid: a slice of a lamp
/// may be thinner than the grid and still outshine the rest of its pixel. Once `stop`, which may be null, is
/// true it returns within a row of pixels; the result is then incomplete.
GeometryUnit RenderGeometryUnit(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame,
                                const Rect& rect, const std::atomic<bool>* stop = nullptr);

/// The mask of RenderGeometryUnit, for the price of four rays a pixel.
EdgeMask FindEdgePixels(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame,
                        const Rect& rect, const std::atomic<bool>* stop = nullptr);

}  // namespace lumifold::render
