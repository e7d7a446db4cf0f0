#include "filter/edges/coverage_means.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <vector>

#include "filter/edges/edge_pixels.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/image/level_mask.h"
#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr size_t kChannels = 6;  // T, then E
constexpr size_t kFirstOfE = 3;

/// What sub-samples are worth beside n samples: the squares of their counts, for the error of evenly spread
/// samples falls nearly as 1/n.
constexpr float kWorthOfSubSamples = kSubSamples * kSubSamples;
/// Against what pixels alike say together, own samples count for as much less.
constexpr float kWorthOfAlike = 4 * kWorthOfSubSamples;
/// With more samples than this the pixels alike have nothing to add.
constexpr float kMostSamples = 128;
constexpr int kRadius = 16;               // of the window in which pixels are alike
constexpr float kStep = 2 * kSubSamples;  // half a sub-sample's part is the unit of how far patches are apart
constexpr float kMostUnlike = 8;          // exp(-8) and less is left out
constexpr float kLeastOfRadiance = 0.5f;  // of what radiates near both, the smaller part over the greater
constexpr float kLargest = 1e30f;

/// T and E of one pixel.
using Means = std::array<float, kChannels>;

/// T and E of all pixels, where they lie on edges as their sub-samples know them, and what the pixels' own
/// samples say beyond that.
struct EdgeMeans {
  EdgeMeans(int width, int height)
      : samples(width, height),
        radiance(width, height),
        sub(static_cast<size_t>(width) * static_cast<size_t>(height)),
        beyond(sub.size()) {}

  Rect bounds() const { return {0, 0, samples.width(), samples.height()}; }
  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(samples.width()) + static_cast<size_t>(x);
  }
  const Means& SubAt(int x, int y) const { return sub[IndexOf(x, y)]; }
  const Means& BeyondAt(int x, int y) const { return beyond[IndexOf(x, y)]; }

  Plane samples;              // of the pixels on edges; below 0 elsewhere
  Plane radiance;             // the most of E in the 3x3 pixels about a pixel on an edge
  std::vector<Means> sub;     // off the edges the pixel's own
  std::vector<Means> beyond;  // 0 off the edges
};

float MeanOverSubSamples(const ConstFloatView& values, int row) {
  float sum = 0;
  for (int sample = 0; sample < kSubSamples; ++sample) sum += values.At(sample, row);
  return sum / kSubSamples;
}

/// The most of E about a pixel; 0 where it is not finite.
float RadianceAt(const EdgeMeans& means, int x, int y) {
  const Rect window = Inflate({x, y, x + 1, y + 1}, 1, means.bounds());
  float most = 0;
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const Means& sub = means.SubAt(i, j);
      most = std::max(most, *std::max_element(sub.begin() + kFirstOfE, sub.end()));
    }
  }
  return most < kLargest ? most : 0.0f;
}

EdgeMeans EdgeMeansOf(const LayeredImage& film, const LayeredImage& edges) {
  EdgeMeans means(film.width(), film.height());
  means.samples.Fill(-1);
  const ConstFloatView n_a = film.Get(layers::kSamplesA);
  const ConstFloatView n_b = film.Get(layers::kSamplesB);
  ForEachEdgePixel(&edges, film.bounds(),
                   [&](int, int x, int y) { means.samples.At(x, y) = n_a.At(x, y) + n_b.At(x, y); });
  for (size_t c = 0; c < kChannels; ++c) {
    const std::string_view layer = c < kFirstOfE ? layers::kAlbedo : layers::kEmission;
    const ConstFloatView own = film.GetColor(layer)[c % 3];
    const ConstFloatView sub = edges.GetColor(layer)[c % 3];
    for (int y = 0; y < film.height(); ++y) {
      for (int x = 0; x < film.width(); ++x) means.sub[means.IndexOf(x, y)][c] = own.At(x, y);
    }
    ForEachEdgePixel(&edges, film.bounds(), [&](int row, int x, int y) {
      const float mean = MeanOverSubSamples(sub, row);
      means.sub[means.IndexOf(x, y)][c] = mean;
      means.beyond[means.IndexOf(x, y)][c] = own.At(x, y) - mean;
    });
  }
  ForEachEdgePixel(&edges, film.bounds(),
                   [&](int, int x, int y) { means.radiance.At(x, y) = RadianceAt(means, x, y); });
  return means;
}

/// How unlike the 3x3 pixels about two pixels are, in squares of a sub-sample's part; E relative to
/// `radiance`. At least kMostUnlike where it is that much.
float Unlikeness(const EdgeMeans& means, int x0, int y0, int x1, int y1, float radiance) {
  const Rect bounds = means.bounds();
  const auto at = [&](int x, int y) -> const Means& {
    return means.SubAt(std::clamp(x, 0, bounds.x1 - 1), std::clamp(y, 0, bounds.y1 - 1));
  };
  float sum = 0;
  for (int j = -1; j <= 1; ++j) {
    for (int i = -1; i <= 1; ++i) {
      const Means& a = at(x0 + i, y0 + j);
      const Means& b = at(x1 + i, y1 + j);
      for (size_t c = 0; c < kChannels; ++c) {
        const float apart = (a[c] - b[c]) * (c < kFirstOfE ? kStep : kStep / radiance);
        sum += apart * apart / kChannels;
      }
      if (!(sum < kMostUnlike)) return kMostUnlike;
    }
  }
  return sum;
}

bool AreNearlyEqual(float a, float b) { return std::min(a, b) >= kLeastOfRadiance * std::max(a, b); }

/// What the own samples of all pixels alike about (x, y) say beyond the sub-samples.
Means BeyondAlike(const EdgeMeans& means, int x, int y) {
  const float radiance = means.radiance.At(x, y);
  const Rect window = Inflate({x, y, x + 1, y + 1}, kRadius, means.bounds());
  Means sums = {};
  float total = kWorthOfSubSamples / means.samples.At(x, y);  // which say that nothing is beyond them
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const float n = means.samples.At(i, j);
      if (!(n > 0) || !AreNearlyEqual(means.radiance.At(i, j), radiance)) continue;
      const float unlike = Unlikeness(means, x, y, i, j, radiance);
      if (!(unlike < kMostUnlike)) continue;
      const float weight = n * Exp(-unlike);
      total += weight;
      for (size_t c = 0; c < kChannels; ++c) sums[c] += weight * means.BeyondAt(i, j)[c];
    }
  }
  for (float& sum : sums) sum /= total;
  return sums;
}

/// What own samples add to the sub-samples' T and E.
Means OwnBeyond(const EdgeMeans& means, int x, int y) {
  const float n = means.samples.At(x, y);
  const bool asks = means.radiance.At(x, y) > 0 && n > 0 && n <= kMostSamples;
  Means beyond = asks ? BeyondAlike(means, x, y) : Means{};
  const float own = n * n / (n * n + (asks ? kWorthOfAlike : kWorthOfSubSamples));
  for (size_t c = 0; c < kChannels; ++c) {
    beyond[c] += own * (means.BeyondAt(x, y)[c] - beyond[c]);
    beyond[c] = std::max(beyond[c], -means.SubAt(x, y)[c]);  // neither T nor E is below 0
  }
  return beyond;
}

}  // namespace

Planes EdgeMeansChange(const LayeredImage& film, const LayeredImage* edges, const Planes& light,
                       TaskPool* pool) {
  Planes change = MakePlanes(3, film.width(), film.height());
  if (edges == nullptr || edges->channels().empty()) return change;
  const EdgeMeans means = EdgeMeansOf(film, *edges);
  const Plane shows_level = LevelMask(film);
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < film.width(); ++x) {
        if (means.samples.At(x, y) < 0) continue;
        const Means beyond = OwnBeyond(means, x, y);
        const Means& known = means.BeyondAt(x, y);
        const float share = shows_level.At(x, y) > 0 ? 0.0f : 1.0f;
        for (size_t c = 0; c < 3; ++c) {
          const size_t e = kFirstOfE + c;
          const float off = share * light[c].At(x, y) * (beyond[c] - known[c]) + beyond[e] - known[e];
          if (std::isfinite(off)) change[c].At(x, y) = off;
        }
      }
    }
  });
  return change;
}

}  // namespace lumifold::filter
