#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "filter/image/edged_image.h"

namespace lumifold::metrics {

/// Parts of a picture that filters find easy or hard. Each pixel is in the first that fits: on an edge (of
/// the film's edge set), in a mirror or behind glass, in a shadow band (direct light changes fast on one
/// surface), on a texture (its albedo differs from a neighbour's), or on a flat surface.
enum class Region : size_t { kEdges, kMirror, kShadow, kTextured, kFlat };
inline constexpr size_t kRegionCount = 5;
inline constexpr std::array<std::string_view, kRegionCount> kRegionNames = {"edges", "mirror", "shadow",
                                                                            "textured", "flat"};

/// The region of each pixel, row by row. What the film does not tell, such as edges of a file without them,
/// makes no region. `film` should have converged: noise in its direct light passes for shadows.
std::vector<Region> RegionsOf(const EdgedImage& film);

/// A mean over all pixels and one over each region; 0 for a region without pixels.
struct RegionMeans {
  double whole = 0;
  std::array<double, kRegionCount> of_region = {};
  std::array<double, kRegionCount> share = {};  // of the pixels
};

/// MSE255 of `picture` against `reference`, as Mse255, by region. Shapes: all of one size, a region a pixel.
RegionMeans Mse255ByRegion(const ConstColorView& picture, const ConstColorView& reference,
                           const std::vector<Region>& regions, float exposure = 1.0f);

}  // namespace lumifold::metrics
