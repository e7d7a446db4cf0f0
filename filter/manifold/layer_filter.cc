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

/// One candidate for each reach.
std::vector<Candidate> CrossFilter(const Halves& halves, const FeaturePair& features,
                                   const ManifoldParams& manifolds, absl::Span<const float> reaches,
                                   TaskPool* pool) {
  ManifoldResult a = ManifoldFilterAtReaches(halves.a, features.b, halves.weight_a.view(), manifolds, reaches,
                                             nullptr, pool);
  ManifoldResult b = ManifoldFilterAtReaches(halves.b, features.a, halves.weight_b.view(), manifolds, reaches,
                                             nullptr, pool);
  std::vector<Candidate> candidates;
  for (size_t r = 0; r < reaches.size(); ++r)
    candidates.push_back({std::move(a.filtered[r]), std::move(b.filtered[r])});
  return candidates;
}

/// Spreads what fireflies lost over their surroundings on the same surface, so that the layer keeps its
/// energy.
Planes SpreadRemoved(const Planes& removed, const Planes& geometry, ConstFloatView weight, TaskPool* pool) {
  ManifoldParams params;
  params.sigma_s = 16;
  params.height = 3;  // geometry alone is simple
  return ManifoldFilter(removed, geometry, weight, params, pool);
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
std::vector<Candidate> MakeCandidates(const Halves& halves, const Planes& geometry, const LayerParams& params,
                                      TaskPool* pool) {
  Guide guide = MakeGuide(halves, halves.a, halves.b, params.knee, pool);
  const float noise = guide.sigma;
  const PatchBasis basis = BasisOf(guide, halves, params.patches, pool);
  std::vector<Candidate> candidates =
      CrossFilter(halves, MakeFeatures(std::move(guide), basis, params.range_factor * noise, geometry, pool),
                  params.pilot_manifolds, {params.pilot_reach}, pool);

  Guide second = MakeGuide(halves, candidates[0].a, candidates[0].b, params.knee, pool);
  const PatchBasis second_basis = BasisOf(second, halves, params.pilot_patches, pool);
  std::vector<Candidate> refined = CrossFilter(
      halves,
      MakeFeatures(std::move(second), second_basis, params.pilot_range_factor * noise, geometry, pool),
      params.manifolds, {params.wide_reach, params.fine_reach}, pool);
  for (Candidate& candidate : refined) candidates.push_back(std::move(candidate));
  return candidates;
}

}  // namespace

Planes FilterLayerOnce(Halves halves, const Planes& geometry, const LayerParams& params, TaskPool* pool) {
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), pool);
  const float sigma = std::max(NoiseLevel(halves, halves.a, halves.b, pool), kLeastNoise * halves.level);
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), params.patches, pool);
  constexpr float kPaperRangeFactor = 1.8f;
  const Planes features = JointFeatures(mean, basis, kPaperRangeFactor * sigma, geometry, pool);
  ManifoldParams manifolds;
  manifolds.sigma_s = params.wide_reach;
  return ManifoldFilter(mean, features, halves.weight.view(), manifolds, pool);
}

Planes FilterLayer(Halves halves, const Planes& geometry, const LayerParams& params, TaskPool* pool) {
  if (!halves.has_noise_estimate) return FilterLayerOnce(std::move(halves), geometry, params, pool);
  const Planes raw = Combine(halves.a, halves.b, halves.share_a.view(), pool);
  const Planes raw_variance = PixelVariance(halves.a, halves.b, halves.share_a.view(), pool);
  const Planes removed = SuppressFireflies(&halves, pool);
  const Planes spread =
      removed.empty() ? Planes{} : SpreadRemoved(removed, geometry, halves.weight.view(), pool);
  const std::vector<Candidate> candidates = MakeCandidates(halves, geometry, params, pool);
  const Planes shares = SelectCandidates(halves, raw_variance, candidates, params.selection, pool);
  return Blend(raw, candidates, shares, spread, halves, pool);
}

}  // namespace lumifold::filter
