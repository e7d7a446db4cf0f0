#include "worker/render/layer_sample.h"

#include <cmath>

namespace lumifold::render {

using scene::Vec3;

bool IsFinite(Vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

Vec3 Recombined(const LayerSample& s) {
  Vec3 sum = (s.direct + s.indirect) * s.albedo + s.emitted + s.glossy * s.glossy_albedo + s.remainder;
  s.levels.ForEach([&](layers::Level, const LevelSample& level) {
    sum += (level.direct + level.indirect) * level.albedo + level.emitted;
  });
  return sum;
}

bool IsFinite(const LayerSample& s) {
  // x * 0 is 0 for finite x and NaN otherwise: this avoids a branch for each value.
  Vec3 zero = s.combined * 0.0f + s.direct * 0.0f + s.indirect * 0.0f + s.albedo * 0.0f + s.emitted * 0.0f +
              s.glossy * 0.0f + s.glossy_albedo * 0.0f;
  s.levels.ForEach([&](layers::Level, const LevelSample& level) {
    zero += level.direct * 0.0f + level.indirect * 0.0f + level.albedo * 0.0f + level.emitted * 0.0f;
  });
  return zero == Vec3{};
}

}  // namespace lumifold::render
