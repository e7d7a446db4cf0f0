#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "filter/image/edged_image.h"

namespace lumifold::metrics {

/// Parts of a picture that differ in how hard they are to filter. A pixel belongs to the first that applies:
/// on an edge (of the film's edge set), seen in a mirror or through glass, in a shadow band (direct light
/// changes fast on one surface), on a texture (its albedo differs from a neighbour's), or on a flat surface.
enum class Region : size_t { kEdges, kMirror, kShadow, kTextured, kFlat };
inline constexpr size_t kRegionCount = 5;
inline constexpr std::array<std::string_view, kRegionCount> kRegionNames = {"edges", "mirror", "shadow",
                                                                            "textured", "flat"};

/// The region of each pixel, row by row. A region whose data the film lacks, such as edges, has no pixels.
/// `film` should have converged: noise in its direct light is classified as shadows.
std::vector<Region> RegionsOf(const EdgedImage& film);

/// A mean over all pixels and one over each region; 0 for a region without pixels.
struct RegionMeans {
  double whole = 0;
  std::array<double, kRegionCount> of_region = {};
  std::array<double, kRegionCount> share = {};  // of the pixels
};

/// Mse255 of `picture` against `reference`, by region.
/// Shapes: all of one size; one region per pixel.
RegionMeans Mse255ByRegion(const ConstColorView& picture, const ConstColorView& reference,
                           const std::vector<Region>& regions, float exposure = 1.0f);

/// The same against a reference that is rendered, of which two independent halves are known: the mean of
/// (picture - A) (picture - B). The noise of the halves cancels, also where it is clamped or bent by the
/// display curve; a subtracted variance is right for small noise alone. May be negative.
RegionMeans Mse255ToHalves(const ConstColorView& picture, const ConstColorView& half_a,
                           const ConstColorView& half_b, const std::vector<Region>& regions,
                           float exposure = 1.0f);

}  // namespace lumifold::metrics
