#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "worker/scene/vec.h"

namespace lumifold::render {

/// Most samples whose numbers are drawn side by side.
inline constexpr size_t kMaxLanes = 16;

/// Bits of each sample.
using LaneBits = std::array<uint32_t, kMaxLanes>;

/// A number of each sample.
using LaneRow = std::array<float, kMaxLanes>;

/// Two random numbers in [0, 1) of each sample.
struct LanePair {
  LaneRow x, y;

  scene::Vec2 At(size_t lane) const { return {x[lane], y[lane]}; }
};

/// Draws a pair of each of the first `count` samples, with the bits of Sampler::Get2D. `shuffle` and
/// `scramble` are Sampler::Seeds. Whole vectors are read and written.
void DrawPairs(const LaneBits& reversed_index, const LaneBits& shuffle, const LaneBits& scramble,
               size_t count, LanePair* out);

}  // namespace lumifold::render
