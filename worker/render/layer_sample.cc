#include "worker/render/layer_sample.h"

#include <cmath>

namespace lumifold::render {

using scene::Vec3;

bool IsFinite(Vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

Vec3 Recombined(const LayerSample& s) {
  Vec3 sum = (s.direct + s.indirect) * s.albedo + s.emitted + s.glossy * s.specular + s.tail;
  s.levels.ForEach([&](layers::Level, const LevelSample& level) {
    sum += (level.direct + level.indirect) * level.albedo + level.emitted;
  });
  return sum;
}

bool IsFinite(const LayerSample& s) {
  bool finite = IsFinite(s.combined) && IsFinite(s.direct) && IsFinite(s.indirect) && IsFinite(s.albedo) &&
                IsFinite(s.emitted) && IsFinite(s.glossy) && IsFinite(s.specular);
  s.levels.ForEach([&](layers::Level, const LevelSample& level) {
    finite = finite && IsFinite(level.direct) && IsFinite(level.indirect) && IsFinite(level.albedo) &&
             IsFinite(level.emitted);
  });
  return finite;
}

}  // namespace lumifold::render
