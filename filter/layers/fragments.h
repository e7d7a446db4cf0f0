#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "filter/layers/frame.h"

namespace lumifold::filter {

/// One surface in an edge pixel.
struct Fragment {
  int row = -1;                     // of the film's fragments; -1: sub-samples alone hit it
  std::array<float, 2> share = {};  // of the samples of each half that hit it
  /// Part of the pixel that it covers, estimated without the other half: by its own samples and the
  /// sub-samples, each weighted by the square of its count, as the error of stratified samples asks.
  std::array<float, 2> coverage = {};
  std::array<float, 3> albedo = {};         // T
  std::array<float, 3> glossy_albedo = {};  // S
  std::array<float, 3> normal = {};         // unit
  float distance = 0;
  float roughness = 0;
  /// Where its sub-samples lie in the mean, px right and down of the pixel's centre.
  std::array<float, 2> place = {};
};

/// The surfaces of the edge pixels of a film: where several meet, the pixel's means resemble none of them.
struct FragmentSet {
  struct Pixel {
    int x = 0;
    int y = 0;
    size_t first = 0;  // of its fragments; it has none if one surface fills it, or if the film has none
    size_t last = 0;   // one after
    /// E of the samples of each half, minus the film's, which is their mean.
    std::array<std::array<float, 3>, 2> emission_of_half = {};
    /// E by its own samples and the sub-samples, minus that of each half.
    std::array<std::array<float, 3>, 2> emission_change = {};
  };
  std::vector<Pixel> pixels;  // in the order of the film's rows
  std::vector<Fragment> fragments;
};

/// The fragments of a frame; no pixel where the film has no edge set, or the pixel no samples.
FragmentSet FragmentsOf(const Frame& frame);

}  // namespace lumifold::filter
