#include "filter/manifold/layer_filter.h"

#include <algorithm>
#include <utility>

#include "filter/manifold/features.h"
#include "filter/manifold/firefly.h"

namespace lumifold::filter {
namespace {

/// Noise below this part of the layer's mean counts as this much, so that a noise-free layer divides by no
/// zero.
constexpr float kLeastNoise = 1e-4f;

/// A picture's two halves in the guide's own, stabilised values.
struct Guide {
  Planes a;
  Planes b;
  float sigma = 0;  // noise of one half
};

Guide MakeGuide(const Halves& halves, const Planes& a, const Planes& b, float knee, TaskPool* pool) {
  Guide guide;
  guide.a = Stabilise(a, knee * halves.level, halves.level, pool);
  guide.b = Stabilise(b, knee * halves.level, halves.level, pool);
  constexpr float kHalfOverMean = 1.41421356f;
  guide.sigma = std::max(kHalfOverMean * NoiseLevel(halves, guide.a, guide.b, pool), kLeastNoise);
  return guide;
}

PatchBasis BasisOf(const Guide& guide, const Halves& halves, const PatchParams& params, TaskPool* pool) {
  const Planes mean = Combine(guide.a, guide.b, halves.share_a.view(), pool);
  return FitPatchBasis(mean, halves.weight.view(), params, pool);
}

/// Feature vectors of both halves.
struct FeaturePair {
  Planes a;
  Planes b;
};

/// Takes the guide over, so that its planes are gone before manifolds need memory.
FeaturePair MakeFeatures(Guide guide, const PatchBasis& basis, float sigma_q, const Planes& geometry,
                         TaskPool* pool) {
  return {JointFeatures(guide.a, basis, sigma_q, geometry, pool),
          JointFeatures(guide.b, basis, sigma_q, geometry, pool)};
}

/// A candidate's values at the points, read from either half.
struct CandidatePoints {
  SlicedPoints a;
  SlicedPoints b;
};

/// The ways a layer was filtered, in step.
struct Candidates {
  std::vector<Candidate> pictures;
  std::vector<CandidatePoints> points;  // none where no points were asked for
};

/// Appends one candidate for each reach.
void CrossFilter(const Halves& halves, const FeaturePair& features, const ManifoldParams& manifolds,
                 absl::Span<const float> reaches, const SlicePoints* points, TaskPool* pool,
                 Candidates* candidates) {
  ManifoldResult a =
      ManifoldFilterAtReaches(halves.a, features.b, halves.weight_a.view(), manifolds, reaches, points, pool);
  ManifoldResult b =
      ManifoldFilterAtReaches(halves.b, features.a, halves.weight_b.view(), manifolds, reaches, points, pool);
  for (size_t r = 0; r < reaches.size(); ++r) {
    candidates->pictures.push_back({std::move(a.filtered[r]), std::move(b.filtered[r])});
    if (points != nullptr) candidates->points.push_back({std::move(a.points[r]), std::move(b.points[r])});
  }
}

void AddProduct(const Plane& share, const Plane& value, int y, Plane* sum) {
  const float* __restrict s = share.Row(y);
  const float* __restrict v = value.Row(y);
  float* __restrict out = sum->Row(y);
  for (int x = 0; x < share.width(); ++x) out[x] += s[x] * v[x];
}

/// shares[0] * raw + sum of shares[i] * candidate i + (1 - shares[0]) * spread.
Planes Blend(const Planes& raw, const std::vector<Candidate>& candidates, const Planes& shares,
             const Planes& spread, const Halves& halves, TaskPool* pool) {
  std::vector<Planes> means;
  for (const Candidate& candidate : candidates)
    means.push_back(Combine(candidate.a, candidate.b, halves.share_a.view(), pool));
  Planes sums = MakePlanes(3, halves.width(), halves.height());
  ForEachBand(pool, halves.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (size_t c = 0; c < 3; ++c) {
        AddProduct(shares[0], raw[c], y, &sums[c]);
        for (size_t i = 0; i < means.size(); ++i) {
          AddProduct(shares[i + 1], means[i][c], y, &sums[c]);
          if (!spread.empty()) AddProduct(shares[i + 1], spread[c], y, &sums[c]);
        }
      }
    }
  });
  return sums;
}

/// The first filtering, guided by noisy patches, and two guided by patches of its result.
Candidates MakeCandidates(const Halves& halves, const Planes& geometry, const LayerParams& params,
                          const SlicePoints* points, TaskPool* pool) {
  Guide guide = MakeGuide(halves, halves.a, halves.b, params.knee, pool);
  const float noise = guide.sigma;
  const PatchBasis basis = BasisOf(guide, halves, params.patches, pool);
  Candidates candidates;
  CrossFilter(halves, MakeFeatures(std::move(guide), basis, params.range_factor * noise, geometry, pool),
              params.pilot_manifolds, {params.pilot_reach}, points, pool, &candidates);

  if (!params.has_second_pass) return candidates;
  const Candidate& pilot = candidates.pictures[0];
  Guide second = MakeGuide(halves, pilot.a, pilot.b, params.knee, pool);
  const PatchBasis second_basis = BasisOf(second, halves, params.pilot_patches, pool);
  CrossFilter(
      halves,
      MakeFeatures(std::move(second), second_basis, params.pilot_range_factor * noise, geometry, pool),
      params.manifolds, {params.wide_reach, params.fine_reach}, points, pool, &candidates);
  return candidates;
}

/// One candidate's values at the points of one pixel, both halves together: sums into values and weights,
/// each times `share`.
void AddPoints(const CandidatePoints& candidate, size_t pixel, size_t samples, float share, float share_a,
               FilteredPoints* sums) {
  for (size_t j = pixel * samples; j < (pixel + 1) * samples; ++j) {
    const float a = candidate.a.weights[j] > 0 ? share * share_a : 0.0f;
    const float b = candidate.b.weights[j] > 0 ? share * (1.0f - share_a) : 0.0f;
    sums->weights[j] += a + b;
    for (size_t c = 0; c < 3; ++c) {
      const size_t at = (pixel * 3 + c) * samples + j - pixel * samples;
      sums->values[at] += a * candidate.a.values[at] + b * candidate.b.values[at];
    }
  }
}

/// The points blended by the choice at their pixels, of the untouched input only its share; `spread` as in
/// Blend().
FilteredPoints BlendPoints(const SlicePoints& points, const std::vector<CandidatePoints>& candidates,
                           const Planes& shares, const Planes& spread, ConstFloatView share_a) {
  FilteredPoints out;
  const size_t samples = points.samples;
  out.values.resize(points.pixels.size() * 3 * samples);
  out.weights.resize(points.pixels.size() * samples);
  for (size_t pixel = 0; pixel < points.pixels.size(); ++pixel) {
    const auto [x, y] = points.pixels[pixel];
    out.raw.push_back(shares[0].At(x, y));
    for (size_t i = 0; i < candidates.size(); ++i)
      AddPoints(candidates[i], pixel, samples, shares[i + 1].At(x, y), share_a.At(x, y), &out);
    for (size_t c = 0; c < 3; ++c) {
      const float added = spread.empty() ? 0.0f : spread[c].At(x, y);
      for (size_t j = 0; j < samples; ++j) {
        float& value = out.values[(pixel * 3 + c) * samples + j];
        const float weight = out.weights[pixel * samples + j];
        value = weight > 0 ? value / weight + added : 0.0f;
      }
    }
  }
  return out;
}

/// Shares, as SelectCandidates', that give all to the wide filtering of the last pass there was.
Planes AllToWide(const Halves& halves, const LayerParams& params, size_t candidates) {
  Planes shares = MakePlanes(candidates + 1, halves.width(), halves.height());
  shares[params.has_second_pass ? 2 : 1].Fill(1);
  return shares;
}

}  // namespace

FilteredLayer FilterLayerOnce(Halves halves, const Planes& geometry, const LayerParams& params,
                              const SlicePoints* points, TaskPool* pool) {
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), pool);
  const float sigma = std::max(NoiseLevel(halves, halves.a, halves.b, pool), kLeastNoise * halves.level);
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), params.patches, pool);
  constexpr float kPaperRangeFactor = 1.8f;
  const Planes features = JointFeatures(mean, basis, kPaperRangeFactor * sigma, geometry, pool);
  ManifoldParams manifolds;
  manifolds.sigma_s = params.wide_reach;
  ManifoldResult result = ManifoldFilterAtReaches(mean, features, halves.weight.view(), manifolds,
                                                  {params.wide_reach}, points, pool);
  FilteredLayer layer{std::move(result.filtered[0]), {}};
  if (points != nullptr) {
    layer.points = {std::move(result.points[0].values), std::move(result.points[0].weights),
                    std::vector<float>(points->pixels.size(), 0.0f)};
  }
  return layer;
}

FilteredLayer FilterLayer(Halves halves, const Planes& geometry, const LayerParams& params,
                          const SlicePoints* points, TaskPool* pool) {
  if (!halves.has_noise_estimate) return FilterLayerOnce(std::move(halves), geometry, params, points, pool);
  const Planes raw = Combine(halves.a, halves.b, halves.share_a.view(), pool);
  const Planes raw_variance = PixelVariance(halves.a, halves.b, halves.share_a.view(), pool);
  const Planes removed = params.suppresses_fireflies ? SuppressFireflies(&halves, pool) : Planes{};
  const Candidates candidates = MakeCandidates(halves, geometry, params, points, pool);
  Planes spread;
  if (!removed.empty()) {
    const Candidate& first = candidates.pictures[0];
    const Planes light = Combine(first.a, first.b, halves.share_a.view(), pool);
    const Planes stable = Stabilise(light, params.knee * halves.level, halves.level, pool);
    spread = SpreadRemoved(removed, stable, geometry, halves.weight.view(), pool);
  }
  const Planes shares =
      params.chooses ? SelectCandidates(halves, raw_variance, candidates.pictures, params.selection, pool)
                     : AllToWide(halves, params, candidates.pictures.size());
  FilteredLayer layer{Blend(raw, candidates.pictures, shares, spread, halves, pool), {}};
  if (points != nullptr)
    layer.points = BlendPoints(*points, candidates.points, shares, spread, halves.share_a.view());
  return layer;
}

}  // namespace lumifold::filter
