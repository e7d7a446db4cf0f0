#include "filter/edges/coverage_means.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "filter/image/edged_image.h"
#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr size_t kChannels = 6;  // T, then E
constexpr size_t kFirstOfE = 3;

/// Weight of the sub-samples beside n * n of n own samples: the error of stratified samples falls nearly as
/// 1/n, so each mean is weighted by the square of its count.
constexpr float kSubSampleWeight = kSubSamples * kSubSamples;
/// The same beside the mean residual of similar pixels, which has less noise than sub-samples alone.
constexpr float kSimilarWeight = 4 * kSubSampleWeight;
/// Samples of a pixel above which similar pixels are not searched: they would add nothing.
constexpr float kMaxSamples = 128;
constexpr int kRadius = 16;                // px: window in which similar pixels are searched
constexpr float kStep = 2 * kSubSamples;   // patch distances are in units of half a sub-sample's part
constexpr float kMaxDistance = 8;          // weights below exp(-8) are left out
constexpr float kMinEmissionRatio = 0.5f;  // of the emission near two similar pixels: smaller over greater

/// T and E of one pixel.
using Coverage = std::array<float, kChannels>;

/// T and E of all pixels, by their sub-samples and by their own samples.
struct EdgeCoverage {
  EdgeCoverage(int width, int height)
      : samples(width, height),
        emission(width, height),
        sub(static_cast<size_t>(width) * static_cast<size_t>(height)),
        residual(sub.size()) {}

  Rect bounds() const { return {0, 0, samples.width(), samples.height()}; }
  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(samples.width()) + static_cast<size_t>(x);
  }
  const Coverage& SubAt(int x, int y) const { return sub[IndexOf(x, y)]; }
  const Coverage& ResidualAt(int x, int y) const { return residual[IndexOf(x, y)]; }

  Plane samples;                   // own samples of edge pixels; below 0 elsewhere
  Plane emission;                  // greatest E in the 3x3 pixels around an edge pixel
  std::vector<Coverage> sub;       // mean over the sub-samples; off the edge set the pixel's own
  std::vector<Coverage> residual;  // mean over own samples minus `sub`; 0 off the edge set
};

float MeanOverSubSamples(const ConstFloatView& values, int row) {
  float sum = 0;
  for (int sample = 0; sample < kSubSamples; ++sample) sum += values.At(sample, row);
  return sum / kSubSamples;
}

/// Greatest E around a pixel; 0 where it is unusable.
float EmissionAround(const EdgeCoverage& coverage, int x, int y) {
  const Rect window = Inflate({x, y, x + 1, y + 1}, 1, coverage.bounds());
  float most = 0;
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const Coverage& sub = coverage.SubAt(i, j);
      most = std::max(most, *std::max_element(sub.begin() + kFirstOfE, sub.end()));
    }
  }
  return most < kLargestUsable ? most : 0.0f;
}

EdgeCoverage EdgeCoverageOf(const Frame& frame) {
  EdgeCoverage coverage(frame.width, frame.height);
  coverage.samples.Fill(-1);
  const EdgeViews& edges = *frame.edges;
  edges.ForEachPixel(frame.bounds(),
                     [&](int, int x, int y) { coverage.samples.At(x, y) = frame.samples.At(x, y); });
  for (size_t c = 0; c < kChannels; ++c) {
    const bool is_albedo = c < kFirstOfE;
    const ConstFloatView own = (is_albedo ? frame.surface.albedo : frame.emission)[c % 3];
    const ConstFloatView sub = (is_albedo ? edges.albedo : edges.emission)[c % 3];
    ForEachPixel(frame.width, frame.height,
                 [&](int x, int y) { coverage.sub[coverage.IndexOf(x, y)][c] = own.At(x, y); });
    edges.ForEachPixel(frame.bounds(), [&](int row, int x, int y) {
      const float mean = MeanOverSubSamples(sub, row);
      coverage.sub[coverage.IndexOf(x, y)][c] = mean;
      coverage.residual[coverage.IndexOf(x, y)][c] = own.At(x, y) - mean;
    });
  }
  edges.ForEachPixel(frame.bounds(),
                     [&](int, int x, int y) { coverage.emission.At(x, y) = EmissionAround(coverage, x, y); });
  return coverage;
}

/// Distance between the 3x3 patches of sub-sample means around two pixels, in squares of half a sub-sample's
/// part; E relative to `emission`. Capped at kMaxDistance.
float PatchDistance(const EdgeCoverage& coverage, int x0, int y0, int x1, int y1, float emission) {
  const Rect bounds = coverage.bounds();
  const auto at = [&](int x, int y) -> const Coverage& {
    return coverage.SubAt(std::clamp(x, 0, bounds.x1 - 1), std::clamp(y, 0, bounds.y1 - 1));
  };
  float sum = 0;
  for (int j = -1; j <= 1; ++j) {
    for (int i = -1; i <= 1; ++i) {
      const Coverage& a = at(x0 + i, y0 + j);
      const Coverage& b = at(x1 + i, y1 + j);
      for (size_t c = 0; c < kChannels; ++c) {
        const float difference = (a[c] - b[c]) * (c < kFirstOfE ? kStep : kStep / emission);
        sum += difference * difference / kChannels;
      }
      if (!(sum < kMaxDistance)) return kMaxDistance;
    }
  }
  return sum;
}

bool AreSimilar(float emission_a, float emission_b) {
  return std::min(emission_a, emission_b) >= kMinEmissionRatio * std::max(emission_a, emission_b);
}

/// Mean residual over the similar pixels around (x, y), weighted by their sample counts.
Coverage SimilarResidual(const EdgeCoverage& coverage, int x, int y) {
  const float emission = coverage.emission.At(x, y);
  const Rect window = Inflate({x, y, x + 1, y + 1}, kRadius, coverage.bounds());
  Coverage sums = {};
  // The sub-samples count as samples of residual 0.
  float total = kSubSampleWeight / coverage.samples.At(x, y);
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const float n = coverage.samples.At(i, j);
      if (!(n > 0) || !AreSimilar(coverage.emission.At(i, j), emission)) continue;
      const float distance = PatchDistance(coverage, x, y, i, j, emission);
      if (!(distance < kMaxDistance)) continue;
      const float weight = n * Exp(-distance);
      total += weight;
      for (size_t c = 0; c < kChannels; ++c) sums[c] += weight * coverage.ResidualAt(i, j)[c];
    }
  }
  for (float& sum : sums) sum /= total;
  return sums;
}

/// The residual that is added to the sub-samples' T and E.
Coverage EstimatedResidual(const EdgeCoverage& coverage, int x, int y) {
  const float n = coverage.samples.At(x, y);
  const bool searches = coverage.emission.At(x, y) > 0 && n > 0 && n <= kMaxSamples;
  Coverage residual = searches ? SimilarResidual(coverage, x, y) : Coverage{};
  const float own_share = n * n / (n * n + (searches ? kSimilarWeight : kSubSampleWeight));
  for (size_t c = 0; c < kChannels; ++c) {
    residual[c] += own_share * (coverage.ResidualAt(x, y)[c] - residual[c]);
    residual[c] = std::max(residual[c], -coverage.SubAt(x, y)[c]);  // neither T nor E is below 0
  }
  return residual;
}

}  // namespace

int CoverageWindow() { return kRadius + 1; }

Planes CoverageChange(const Frame& frame, const Planes& light, TaskPool* pool) {
  Planes change = MakePlanes(3, frame.width, frame.height);
  if (!frame.edges.has_value()) return change;
  const EdgeCoverage coverage = EdgeCoverageOf(frame);
  ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
    if (coverage.samples.At(x, y) < 0) return;
    const Coverage estimated = EstimatedResidual(coverage, x, y);
    const Coverage& own = coverage.ResidualAt(x, y);
    const float share = frame.level_mask.At(x, y) > 0 ? 0.0f : 1.0f;
    for (size_t c = 0; c < 3; ++c) {
      const size_t e = kFirstOfE + c;
      const float off = share * light[c].At(x, y) * (estimated[c] - own[c]) + estimated[e] - own[e];
      if (std::isfinite(off)) change[c].At(x, y) = off;
    }
  });
  return change;
}

}  // namespace lumifold::filter
