#pragma once

#include <cstdint>

namespace lumifold {

/// Mixes 64 bits so that every input bit reaches every output bit (the finaliser of SplitMix64).
constexpr uint64_t MixBits(uint64_t x) {
  x ^= x >> 30;
  x *= 0xbf58476d1ce4e5b9u;
  x ^= x >> 27;
  x *= 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

}  // namespace lumifold
