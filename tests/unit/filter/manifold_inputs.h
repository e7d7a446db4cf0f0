#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

struct ManifoldInput {
  Planes signals;
  Planes features;
  Plane mask;
};

/// Smooth regions with edges, noise on both signals and features, and a mask with holes.
inline ManifoldInput MakeManifoldInput(int width, int height, size_t dimensions, bool has_holes,
                                       uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  ManifoldInput input{MakePlanes(3, width, height), MakePlanes(dimensions, width, height),
                      Plane(width, height)};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int region = (x > width / 2 ? 1 : 0) + (2 * y > x ? 2 : 0);
      for (size_t k = 0; k < dimensions; ++k) {
        const float level = static_cast<float>((region * (static_cast<int>(k) + 3)) % 5);
        input.features[k].At(x, y) = 1.3f * level + 0.02f * static_cast<float>(x) + 0.3f * normal(random);
      }
      for (Plane& signal : input.signals)
        signal.At(x, y) = static_cast<float>(region) + 0.5f * normal(random);
      input.mask.At(x, y) = has_holes && (x * 7 + y * 13) % 11 < 3 ? 0.0f : 1.0f;
    }
  }
  return input;
}

/// `samples` points in every seventh pixel, near its own features or far from them all.
inline SlicePoints MakePoints(const ManifoldInput& input, size_t samples, size_t own_features) {
  std::mt19937 random(21);
  std::normal_distribution<float> normal(0.0f, 0.7f);
  SlicePoints points;
  points.own_features = own_features;
  const size_t shared = input.features.size() - own_features;
  for (int y = 0; y < input.mask.height(); ++y) {
    for (int x = y % 7; x < input.mask.width(); x += 7) {
      for (size_t j = 0; j < samples; ++j) {
        points.pixels.push_back({x, y});
        for (size_t k = 0; k < own_features; ++k) {
          const float far = (x + y) % 5 == 0 && j == 1 ? 300.0f : 0.0f;
          points.features.push_back(input.features[shared + k].At(x, y) + far + normal(random));
        }
      }
    }
  }
  return points;
}

/// Gives points signals of their own, and weights of which some are 0.
inline void AddSignals(size_t channels, SlicePoints* points) {
  std::mt19937 random(22);
  std::normal_distribution<float> normal(2.0f, 0.5f);
  const size_t count = points->pixels.size();
  for (size_t i = 0; i < count * channels; ++i) points->signals.push_back(normal(random));
  for (size_t i = 0; i < count; ++i) points->weights.push_back(static_cast<float>(i % 3) * 0.5f);
}

}  // namespace lumifold::filter
