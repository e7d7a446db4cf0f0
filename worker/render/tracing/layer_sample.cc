#include "worker/render/tracing/layer_sample.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace lumifold::render {

using scene::Vec3;

namespace {

bool LevelsAreFinite(const ByLevel<LevelSample>& levels) {
  bool all = true;
  levels.ForEach([&](layers::Level, const LevelSample& level) {
    all = all && IsFinite(level.direct) && IsFinite(level.indirect) && IsFinite(level.albedo) &&
          IsFinite(level.emitted);
  });
  return all;
}

}  // namespace

bool IsFinite(Vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

bool IsFinite(const LayerSample& s) {
  // In NaN and infinity all bits of the exponent are set. The colours are tested side by side, without a
  // branch for each.
  constexpr uint32_t kExponent = 0x7f800000;
  std::array<uint32_t, offsetof(LayerSample, first) / sizeof(float)> bits;
  std::memcpy(bits.data(), &s, sizeof(bits));
  uint32_t bad = 0;
  for (const uint32_t value : bits) bad |= static_cast<uint32_t>((value & kExponent) == kExponent);
  return bad == 0 && (s.levels.IsEmpty() || LevelsAreFinite(s.levels));
}

}  // namespace lumifold::render
