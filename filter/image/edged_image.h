#pragma once

#include "filter/image/layered_image.h"
#include "filter/image/rect.h"

namespace lumifold {

/// Sub-samples of a pixel, in a 4x4 grid, row by row.
inline constexpr int kSubSamples = 16;

/// A picture and the sub-samples of its edge pixels, whose mean says too little: what a geometry unit and a
/// film are. `edges` is kSubSamples wide, a row an edge pixel in the order of the frame's rows, with the
/// channels pixel.X pixel.Y (the pixel's place in the whole frame, alike in all columns), N.X N.Y N.Z,
/// distance.Z, albedo.R .G .B, emission.R .G .B, id.Y and mask.Y of each sub-sample; it has neither rows nor
/// channels where no pixel lies on an edge.
struct EdgedImage {
  LayeredImage pixels;
  LayeredImage edges;
};

/// The rows of an edge set whose pixels lie in `rect`, their places counted from its corner; without channels
/// where there are none. An edge set that lacks places stays whole, for its reader to refuse.
LayeredImage EdgesInside(const LayeredImage& edges, const Rect& rect);

/// Moves the places of an edge set, in pixels; one without channels has none.
void MovePlaces(int right, int down, LayeredImage* edges);

}  // namespace lumifold
