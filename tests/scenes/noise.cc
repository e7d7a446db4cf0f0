#include "tests/scenes/noise.h"

namespace lumifold::scenes {
namespace {

// Finaliser of MurmurHash3 (A. Appleby, public domain).
std::uint32_t Scramble(std::uint32_t h) {
  h ^= h >> 16;
  h *= 0x85ebca6bu;
  h ^= h >> 13;
  h *= 0xc2b2ae35u;
  return h ^ h >> 16;
}

int Wrap(int i, int period) {
  if (period <= 0) return i;
  const int r = i % period;
  return r < 0 ? r + period : r;
}

}  // namespace

double HashNoise(int x, int y, unsigned seed) {
  const std::uint32_t row = Scramble(static_cast<std::uint32_t>(y) + Scramble(seed + 0x9e3779b9u));
  return (Scramble(static_cast<std::uint32_t>(x) + row) >> 8) * (1.0 / (1 << 24));
}

double ValueNoise(Vec2 p, unsigned seed, Vec2 period) {
  const double x0 = std::floor(p.x), y0 = std::floor(p.y);
  const double tx = SmoothStep(0, 1, p.x - x0), ty = SmoothStep(0, 1, p.y - y0);
  const auto at = [&](int dx, int dy) {
    const int x = Wrap(static_cast<int>(x0) + dx, static_cast<int>(period.x));
    const int y = Wrap(static_cast<int>(y0) + dy, static_cast<int>(period.y));
    return HashNoise(x, y, seed);
  };
  return Mix(Mix(at(0, 0), at(1, 0), tx), Mix(at(0, 1), at(1, 1), tx), ty);
}

double Fbm(Vec2 p, int octaves, unsigned seed, Vec2 period) {
  double sum = 0, weight = 1, total = 0;
  for (int octave = 0; octave < octaves; ++octave) {
    sum += weight * ValueNoise(p, seed + static_cast<unsigned>(octave), period);
    total += weight;
    weight /= 2;
    p = p * 2;
    period = period * 2;
  }
  return sum / total;
}

}  // namespace lumifold::scenes
