#pragma once

#include <array>
#include <cstddef>

#include "filter/image/layered_image.h"
#include "filter/image/rect.h"

namespace lumifold {

/// Sub-samples of a pixel, in a 4x4 grid, row by row.
inline constexpr int kSubSamples = 16;

/// Where sub-sample j lies in its pixel, in (0, 1)^2: right, down. Each of 16 columns and each of 16 rows
/// of the pixel has one sub-sample, so that edges along the axes are resolved to a sixteenth of a pixel, not
/// to a fourth.
constexpr std::array<float, 2> PlaceOfSubSample(int j) {
  constexpr std::array<int, 4> kShift = {1, 3, 0, 2};
  const int x = j % 4;
  const int y = j / 4;
  const auto at = [&](int cell, int other) {
    return (static_cast<float>(4 * cell + kShift[static_cast<size_t>(other)]) + 0.5f) / kSubSamples;
  };
  return {at(x, y), at(y, 3 - x)};
}

/// The most fragments of a pixel in one pass: samples of further surfaces belong to the last one. A pixel of
/// a film may have more, because its passes may differ.
inline constexpr int kMaxFragments = 8;

/// A picture and two lists of what its edge pixels consist of, for which a mean is not enough: the data of a
/// unit and of a film. Both lists are in the order of the frame's rows, and begin with the channels pixel.X
/// and pixel.Y, the pixel's coordinates in the whole frame. A list has neither rows nor channels if there is
/// nothing in it.
///
/// `edges`, the edge set, of geometry units and films: kSubSamples wide, one row per edge pixel. Its further
/// channels are N.X N.Y N.Z, distance.Z, albedo.R .G .B, emission.R .G .B, id.Y and mask.Y of each
/// sub-sample; the coordinates are equal in all columns.
///
/// `fragments`, of pass units and films: 1 wide, one row for each surface that the camera samples of an edge
/// pixel hit first; those of a pixel follow each other with ascending surface.Y (see SurfaceKey). Its further
/// channels are N.X N.Y N.Z, distance.Z, the halves of direct and indirect, albedo, samples_a.Y and
/// samples_b.Y: the layers and counts of the pixel, of the samples alone that hit this surface. In a film
/// normals, distances and layers are means over these samples, so the mean normal is shorter than 1 where
/// they differ; in a unit all are sums. Samples that hit nothing are in no fragment.
struct EdgedImage {
  LayeredImage pixels;
  LayeredImage edges = {};
  LayeredImage fragments = {};
};

/// The rows of an edge set or of fragments whose pixels lie in `rect`, with coordinates relative to its
/// corner; without channels if there are none. A list without pixel.X or pixel.Y is returned whole, for its
/// reader to refuse.
LayeredImage EdgesInside(const LayeredImage& edges, const Rect& rect);

/// Adds (right, down) to the pixel coordinates of an edge set or of fragments. Does nothing to a list without
/// channels.
void MovePlaces(int right, int down, LayeredImage* edges);

}  // namespace lumifold
