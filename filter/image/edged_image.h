#pragma once

#include "filter/image/layered_image.h"
#include "filter/image/rect.h"

namespace lumifold {

/// Sub-samples of a pixel, in a 4x4 grid, row by row.
inline constexpr int kSubSamples = 16;

/// A picture and the sub-samples of its edge pixels, for which a mean is not enough: the data of a geometry
/// unit and of a film. `edges` is kSubSamples wide and has one row per edge pixel, in the order of the
/// frame's rows. Its channels are pixel.X pixel.Y (the pixel's coordinates in the whole frame, equal in all
/// columns), N.X N.Y N.Z, distance.Z, albedo.R .G .B, emission.R .G .B, id.Y and mask.Y of each sub-sample.
/// It has neither rows nor channels if no pixel lies on an edge.
struct EdgedImage {
  LayeredImage pixels;
  LayeredImage edges;
};

/// The rows of an edge set whose pixels lie in `rect`, with coordinates relative to its corner; without
/// channels if there are none. An edge set without pixel.X or pixel.Y is returned whole, for its reader to
/// refuse.
LayeredImage EdgesInside(const LayeredImage& edges, const Rect& rect);

/// Adds (right, down) to the pixel coordinates of an edge set. Does nothing to one without channels.
void MovePlaces(int right, int down, LayeredImage* edges);

}  // namespace lumifold
