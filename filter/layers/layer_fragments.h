#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "filter/layers/fragments.h"
#include "filter/layers/halves.h"
#include "filter/layers/product.h"

namespace lumifold::filter {

/// The light of D, I or G on the fragments of a film. Index 0 of a pair is half A, 1 is half B. A fragment
/// that reflects such light is a point; the points of a pixel follow each other.
struct LayerFragments {
  struct Pixel {
    int x = 0;  // relative to the layer's box
    int y = 0;
    size_t first = 0;  // of its points
    size_t last = 0;   // one after
  };
  std::vector<Pixel> pixels;
  std::vector<std::array<int, 2>> places;  // of each point: x, y of its pixel
  std::vector<float> offsets;              // 2 of each point: Fragment::place
  size_t own_features = 0;
  std::vector<float> features;                        // geometry: own_features of each point
  std::vector<std::array<float, 3>> factor;           // T of D and I, S of G
  std::array<std::vector<float>, 2> share, coverage;  // as in Fragment
  std::array<std::vector<float>, 2> light;            // 3 of each point; 0 where the half has no sample
  std::array<std::vector<float>, 2> noisy;            // the same, as in the film

  bool IsEmpty() const { return pixels.empty(); }

  /// Sum over the points of a pixel of weight * factor * value; channel c of values that are 3 of each point.
  float SumOver(const Pixel& pixel, const std::vector<float>& weight, const std::vector<float>& values,
                size_t c) const {
    float sum = 0;
    for (size_t i = pixel.first; i < pixel.last; ++i) sum += weight[i] * factor[i][c] * values[3 * i + c];
    return sum;
  }
  /// What the film's light of half `h` brings to a pixel of C.
  float Noisy(const Pixel& pixel, size_t h, size_t c) const { return SumOver(pixel, share[h], noisy[h], c); }
};

/// The fragments of D, I or G; empty for other products.
LayerFragments LayerFragmentsOf(const Frame& frame, const FragmentSet& set, const Product& product,
                                const GeometryRanges& ranges);

/// Mean of `values`, 3 of each point, over the points of a pixel for which has(point) is true, weighted by
/// their coverage in half `h`; none where these cover nothing.
template <typename Has>
std::optional<std::array<float, 3>> MeanOverPoints(const LayerFragments& fragments,
                                                   const LayerFragments::Pixel& pixel, size_t h,
                                                   const std::vector<float>& values, const Has& has) {
  std::array<float, 3> mean = {};
  float total = 0;
  for (size_t i = pixel.first; i < pixel.last; ++i) {
    if (!has(i)) continue;
    const float weight = fragments.coverage[h][i];
    total += weight;
    for (size_t c = 0; c < 3; ++c) mean[c] += weight * values[3 * i + c];
  }
  if (!(total > 0)) return std::nullopt;
  for (float& m : mean) m /= total;
  return mean;
}

/// Replaces the features of each pixel by those of the surface that covers most of it: means over several
/// surfaces resemble none of them.
void UseDominantFeatures(const LayerFragments& fragments, Planes* geometry);

/// Converts the fragments' light to the halves' unit, and replaces the halves' pixels by the means over their
/// fragments.
void UseFragments(LayerFragments* fragments, Halves* halves);

}  // namespace lumifold::filter
