#include "filter/image/surface_key.h"

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "filter/image/mix_bits.h"

namespace lumifold {
namespace {

constexpr uint64_t kKeys = (uint64_t{1} << 24) - 1;  // every whole number up to 2^24 is a float
/// Number of the axis that the normal follows most, from 0 to 5: x, y, z, -x, -y, -z.
uint64_t CellOf(const std::array<float, 3>& normal) {
  size_t axis = 0;
  for (size_t i = 1; i < normal.size(); ++i) {
    if (std::abs(normal[i]) > std::abs(normal[axis])) axis = i;
  }
  return axis + (normal[axis] < 0 ? normal.size() : 0);
}

}  // namespace

float SurfaceKey(float object_id, std::array<float, 3> normal, float distance) {
  constexpr float kEndOfIds = 0x1p32f;
  if (!(object_id >= 1 && object_id < kEndOfIds) || !(distance > 0) || !std::isfinite(distance)) return 0;
  for (const float component : normal) {
    if (!std::isfinite(component)) return 0;
  }
  const uint64_t name = static_cast<uint64_t>(object_id) | CellOf(normal) << 32;  // disjoint bits
  return static_cast<float>(1 + MixBits(name) % kKeys);
}

}  // namespace lumifold
