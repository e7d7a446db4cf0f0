#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "filter/image/edged_image.h"

namespace lumifold::charts {

/// Parts of a picture that filters find easy or hard. Each pixel is in the first that fits: on an edge (of
/// the film's edge set), in a mirror or behind glass, on a texture (its albedo differs from a neighbour's),
/// or on a flat surface.
enum class Region : size_t { kEdges, kMirror, kTextured, kFlat };
inline constexpr size_t kRegionCount = 4;
inline constexpr std::array<std::string_view, kRegionCount> kRegionNames = {"edges", "mirror", "textured",
                                                                            "flat"};

/// The region of each pixel, row by row. What the film does not tell, such as edges of a file without them,
/// makes no region.
std::vector<Region> RegionsOf(const EdgedImage& film);

/// A mean over all pixels and one over each region; 0 for a region without pixels.
struct RegionMeans {
  double whole = 0;
  std::array<double, kRegionCount> of_region = {};
};

/// MSE255 of `picture` against `reference`, as metrics::Mse255, by region. All of one size.
RegionMeans Mse255ByRegion(const ConstColorView& picture, const ConstColorView& reference,
                           const std::vector<Region>& regions);

}  // namespace lumifold::charts
