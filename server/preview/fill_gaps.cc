#include "server/preview/fill_gaps.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

namespace lumifold::server {
namespace {

struct Pixel {
  std::array<float, 3> colour{};
  bool is_known = false;
};

/// A picture at some reduction.
struct Level {
  int width = 0;
  int height = 0;
  std::vector<Pixel> pixels;

  size_t Index(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x);
  }
  Pixel& At(int x, int y) { return pixels[Index(x, y)]; }
  const Pixel& At(int x, int y) const { return pixels[Index(x, y)]; }
};

Level Finest(const Plane& samples, const ColorView& colour) {
  Level level{samples.width(), samples.height(), {}};
  level.pixels.reserve(static_cast<size_t>(level.width) * static_cast<size_t>(level.height));
  for (int y = 0; y < level.height; ++y) {
    for (int x = 0; x < level.width; ++x) {
      level.pixels.push_back(
          {{colour[0].At(x, y), colour[1].At(x, y), colour[2].At(x, y)}, samples.At(x, y) > 0});
    }
  }
  return level;
}

/// Means of the known ones of 2 x 2 pixels.
Level Halved(const Level& fine) {
  Level coarse{(fine.width + 1) / 2, (fine.height + 1) / 2, {}};
  coarse.pixels.resize(static_cast<size_t>(coarse.width) * static_cast<size_t>(coarse.height));
  for (int y = 0; y < coarse.height; ++y) {
    for (int x = 0; x < coarse.width; ++x) {
      Pixel& pixel = coarse.At(x, y);
      float count = 0;
      for (int v = 2 * y; v < std::min(2 * y + 2, fine.height); ++v) {
        for (int u = 2 * x; u < std::min(2 * x + 2, fine.width); ++u) {
          if (!fine.At(u, v).is_known) continue;
          for (size_t c = 0; c < 3; ++c) pixel.colour[c] += fine.At(u, v).colour[c];
          ++count;
        }
      }
      pixel.is_known = count > 0;
      for (float& value : pixel.colour) value /= std::max(count, 1.0f);
    }
  }
  return coarse;
}

/// The pixel of twice the size, interpolated.
Pixel Enlarged(const Level& coarse, int x, int y) {
  // Of 2 x 2 fine pixels in a coarse one, each is a quarter of it from its centre.
  const std::array<int, 2> columns = {x / 2, std::clamp(x / 2 + (x % 2 == 0 ? -1 : 1), 0, coarse.width - 1)};
  const std::array<int, 2> rows = {y / 2, std::clamp(y / 2 + (y % 2 == 0 ? -1 : 1), 0, coarse.height - 1)};
  constexpr std::array<float, 2> kWeights = {0.75f, 0.25f};
  Pixel pixel;
  for (size_t v = 0; v < 2; ++v) {
    for (size_t u = 0; u < 2; ++u) {
      for (size_t c = 0; c < 3; ++c)
        pixel.colour[c] += kWeights[u] * kWeights[v] * coarse.At(columns[u], rows[v]).colour[c];
    }
  }
  pixel.is_known = true;
  return pixel;
}

void FillFrom(const Level& coarse, Level* fine) {
  for (int y = 0; y < fine->height; ++y) {
    for (int x = 0; x < fine->width; ++x) {
      if (!fine->At(x, y).is_known) fine->At(x, y) = Enlarged(coarse, x, y);
    }
  }
}

}  // namespace

void FillGaps(const Plane& samples, ColorView colour) {
  std::vector<Level> levels = {Finest(samples, colour)};
  const std::vector<Pixel>& pixels = levels.front().pixels;
  const auto known =
      std::count_if(pixels.begin(), pixels.end(), [](const Pixel& pixel) { return pixel.is_known; });
  if (known == 0 || known == static_cast<std::ptrdiff_t>(pixels.size())) return;
  while (levels.back().width > 1 || levels.back().height > 1) levels.push_back(Halved(levels.back()));
  for (size_t i = levels.size() - 1; i > 0; --i) FillFrom(levels[i], &levels[i - 1]);
  for (int y = 0; y < samples.height(); ++y) {
    for (int x = 0; x < samples.width(); ++x) {
      for (size_t c = 0; c < 3; ++c) colour[c].At(x, y) = levels.front().At(x, y).colour[c];
    }
  }
}

}  // namespace lumifold::server
