#include "filter/denoise/layer_filter.h"

#include <algorithm>
#include <utility>

#include "filter/denoise/firefly.h"
#include "filter/layers/features.h"

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

/// Takes the guide over: its planes are gone before manifolds need memory.
FeaturePair MakeFeatures(Guide&& from, const PatchBasis& basis, float sigma_q, const Planes& geometry,
                         TaskPool* pool) {
  const Guide guide = std::move(from);
  return {JointFeatures(guide.a, basis, sigma_q, geometry, pool),
          JointFeatures(guide.b, basis, sigma_q, geometry, pool)};
}

/// What one half was filtered to.
struct HalfResult {
  Planes picture;
  SlicedPoints points;  // empty where no points were asked for
};

/// One way a layer was filtered.
struct Filtering {
  HalfResult a;
  HalfResult b;
};

Planes Difference(const Planes& x, const Planes& y, TaskPool* pool) {
  Planes difference = MakeUninitializedPlanes(x.size(), x[0].width(), x[0].height());
  ForEachBand(pool, x[0].height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < x.size(); ++c) {
      for (int row = y0; row < y1; ++row) {
        const float* __restrict from = x[c].Row(row);
        const float* __restrict less = y[c].Row(row);
        float* __restrict out = difference[c].Row(row);
        for (int i = 0; i < x[c].width(); ++i) out[i] = from[i] - less[i];
      }
    }
  });
  return difference;
}

/// What the base finds counts, with what is added where that finds anything: `added` is 0 elsewhere.
void AddToPoints(const SlicedPoints& base, SlicedPoints* added) {
  for (size_t i = 0; i < base.values.size(); ++i) added->values[i] += base.values[i];
  added->weights = base.weights;
}

/// How one half is filtered.
struct Pass {
  const ManifoldParams& manifolds;
  float reach;
  const SlicePoints* points;  // may be null
  TaskPool* pool;
};

/// `base`, which may be null and is 0 then, and what filtering gives of all that it leaves of the half.
HalfResult FilterHalf(const Planes& half, ConstFloatView weight, const Planes& features,
                      const HalfResult* base, const Pass& pass) {
  const Planes rest = base != nullptr ? Difference(half, base->picture, pass.pool) : Planes{};
  ManifoldResult result = ManifoldFilterAtPoints(base != nullptr ? rest : half, features, weight,
                                                 pass.manifolds, pass.reach, pass.points, pass.pool);
  HalfResult filtered{std::move(result.filtered), std::move(result.points)};
  if (base != nullptr) {
    AddPlanes(base->picture, pass.pool, absl::MakeSpan(filtered.picture));
    AddToPoints(base->points, &filtered.points);
  }
  return filtered;
}

/// Each half guided by the other.
Filtering CrossFilter(const Halves& halves, const FeaturePair& features, const Filtering* base,
                      const Pass& pass) {
  return {
      FilterHalf(halves.a, halves.weight_a.view(), features.b, base != nullptr ? &base->a : nullptr, pass),
      FilterHalf(halves.b, halves.weight_b.view(), features.a, base != nullptr ? &base->b : nullptr, pass)};
}

/// A candidate's values at the points, read from either half.
struct CandidatePoints {
  SlicedPoints a;
  SlicedPoints b;
};

/// The ways a layer was filtered, in step.
struct Candidates {
  std::vector<Candidate> pictures;
  std::vector<CandidatePoints> points;  // empty ones where no points were asked for
};

void Append(Filtering filtering, Candidates* candidates) {
  candidates->pictures.push_back({std::move(filtering.a.picture), std::move(filtering.b.picture)});
  candidates->points.push_back({std::move(filtering.a.points), std::move(filtering.b.points)});
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
  means.reserve(candidates.size());
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

/// The first filtering, guided by noisy patches, and the second: guided by patches of the first, of what that
/// leaves of the halves.
Candidates MakeCandidates(const Halves& halves, const Planes& geometry, const LayerParams& params,
                          const SlicePoints* points, TaskPool* pool) {
  Guide guide = MakeGuide(halves, halves.a, halves.b, params.knee, pool);
  const float noise = guide.sigma;
  const PatchBasis basis = BasisOf(guide, halves, params.patches, pool);
  Candidates candidates;
  Filtering first =
      CrossFilter(halves, MakeFeatures(std::move(guide), basis, params.range_factor * noise, geometry, pool),
                  nullptr, {params.pilot_manifolds, params.pilot_reach, points, pool});
  if (!params.has_second_pass) {
    Append(std::move(first), &candidates);
    return candidates;
  }
  Guide second = MakeGuide(halves, first.a.picture, first.b.picture, params.knee, pool);
  const PatchBasis second_basis = BasisOf(second, halves, params.pilot_patches, pool);
  Filtering rest = CrossFilter(
      halves,
      MakeFeatures(std::move(second), second_basis, params.pilot_range_factor * noise, geometry, pool),
      &first, {params.manifolds, params.reach, points, pool});
  Append(std::move(first), &candidates);
  Append(std::move(rest), &candidates);
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

/// Shares, as SelectCandidates', that give all to the last candidate.
Planes AllToLast(const Halves& halves, size_t candidates) {
  Planes shares = MakePlanes(candidates + 1, halves.width(), halves.height());
  shares.back().Fill(1);
  return shares;
}

}  // namespace

FilteredLayer FilterLayerOnce(Halves halves, const Planes& geometry, const PatchParams& patches,
                              const OnePassParams& params, const SlicePoints* points, TaskPool* pool) {
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), pool);
  const float sigma = std::max(NoiseLevel(halves, halves.a, halves.b, pool), kLeastNoise * halves.level);
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), patches, pool);
  const Planes features = JointFeatures(mean, basis, params.range_factor * sigma, geometry, pool);
  ManifoldResult result = ManifoldFilterAtPoints(mean, features, halves.weight.view(), params.manifolds,
                                                 params.manifolds.sigma_s, points, pool);
  FilteredLayer layer{std::move(result.filtered), {}};
  if (points != nullptr) {
    layer.points = {std::move(result.points.values), std::move(result.points.weights),
                    std::vector<float>(points->pixels.size(), 0.0f)};
  }
  return layer;
}

FilteredLayer FilterLayer(Halves halves, const Planes& geometry, const LayerParams& params,
                          const SlicePoints* points, TaskPool* pool) {
  if (!halves.has_noise_estimate) {
    return FilterLayerOnce(std::move(halves), geometry, params.patches, params.without_halves, points, pool);
  }
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
                     : AllToLast(halves, candidates.pictures.size());
  FilteredLayer layer{Blend(raw, candidates.pictures, shares, spread, halves, pool), {}};
  if (points != nullptr)
    layer.points = BlendPoints(*points, candidates.points, shares, spread, halves.share_a.view());
  return layer;
}

}  // namespace lumifold::filter
