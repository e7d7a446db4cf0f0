#pragma once

#include <cstdint>
#include <random>
#include <string>

#include "filter/image/layered_image.h"
#include "filter/image/layers.h"
#include "server/film/unit_layout.h"
#include "server/scheduler/tile_grid.h"

namespace lumifold {

/// What a worker might deliver for a unit: made-up pixels that depend on (seed, unit) alone, with the counts
/// a pass of `samples` has.
inline LayeredImage RandomUnit(const scheduler::UnitKey& key, const Rect& rect,
                               scheduler::SampleRange samples, uint32_t seed) {
  std::seed_seq mix{seed, static_cast<uint32_t>(key.frame), static_cast<uint32_t>(key.tile),
                    static_cast<uint32_t>(key.pass), static_cast<uint32_t>(key.kind)};
  std::mt19937 random(mix);
  std::uniform_real_distribution<float> value(0.0f, 1.0f);
  LayeredImage unit(rect.width(), rect.height());
  const bool is_pass = key.kind == v1::UNIT_KIND_PASS;
  for (const std::string& name : is_pass ? film::PassChannels() : film::GeometryChannels()) {
    const FloatView view = unit.Add(name);
    for (int y = 0; y < rect.height(); ++y) {
      for (int x = 0; x < rect.width(); ++x)
        view.At(x, y) = value(random) * (is_pass ? static_cast<float>(samples.count()) : 1.0f);
    }
  }
  if (is_pass) {
    // Even sample indices are half A's, odd ones half B's.
    const int count_b = samples.last / 2 - samples.first / 2;
    const int count_a = samples.count() - count_b;
    for (int y = 0; y < rect.height(); ++y) {
      for (int x = 0; x < rect.width(); ++x) {
        unit.Get(layers::kSamplesA).At(x, y) = static_cast<float>(count_a);
        unit.Get(layers::kSamplesB).At(x, y) = static_cast<float>(count_b);
      }
    }
  }
  return unit;
}

}  // namespace lumifold
