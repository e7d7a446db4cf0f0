#include "filter/manifold/selection.h"

#include <algorithm>
#include <cmath>

#include "filter/manifold/box_mean.h"

namespace lumifold::filter {
namespace {

/// Errors below this part of the input's own count as this much.
constexpr float kLeastError = 0.01f;

/// 1 where both halves are known: only there can errors be measured.
Plane MeasurableMask(const Halves& halves) {
  Plane mask(halves.width(), halves.height());
  for (int y = 0; y < mask.height(); ++y) {
    for (int x = 0; x < mask.width(); ++x)
      mask.At(x, y) = halves.weight_a.At(x, y) * halves.weight_b.At(x, y);
  }
  return mask;
}

Plane RawError(const Planes& variance, TaskPool* pool) {
  Plane error(variance[0].width(), variance[0].height());
  ForEachBand(pool, error.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (const Plane& channel : variance) {
        for (int x = 0; x < error.width(); ++x) error.At(x, y) += channel.At(x, y);
      }
    }
  });
  return error;
}

Plane CandidateError(const Halves& halves, const Candidate& candidate, TaskPool* pool) {
  Plane error(halves.width(), halves.height());
  ForEachBand(pool, error.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (size_t c = 0; c < 3; ++c) {
        const float* __restrict a = halves.a[c].Row(y);
        const float* __restrict b = halves.b[c].Row(y);
        const float* __restrict filtered_a = candidate.a[c].Row(y);
        const float* __restrict filtered_b = candidate.b[c].Row(y);
        float* __restrict sum = error.Row(y);
        for (int x = 0; x < error.width(); ++x) {
          const float ab = filtered_a[x] - b[x];
          const float ba = filtered_b[x] - a[x];
          const float noise = a[x] - b[x];
          const float disagreement = filtered_a[x] - filtered_b[x];
          sum[x] += 0.5f * (ab * ab + ba * ba - noise * noise) - 0.25f * disagreement * disagreement;
        }
      }
    }
  });
  return error;
}

Plane Smooth(const Plane& error, const Plane& mask, const SelectionParams& params, TaskPool* pool) {
  Plane smooth = BoxMean(error.view(), mask.view(), params.error_radius, pool);
  const Plane region = BoxMean(error.view(), mask.view(), params.region_radius, pool);
  ForEachBand(pool, smooth.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < smooth.width(); ++x) {
        smooth.At(x, y) += params.region_share * (region.At(x, y) - smooth.At(x, y));
      }
    }
  });
  return smooth;
}

/// Shares one pixel among the ways to filter it: by the fourth power of the inverse error, so that the best
/// takes nearly all unless others are as good, and a rounding error never turns the picture.
void ShareOut(const Planes& errors, int x, int y, Planes* shares) {
  const float floor =
      kLeastError * errors[0].At(x, y);  // estimates of small errors are rough, and may fall below 0
  float best = INFINITY;
  for (const Plane& error : errors) best = std::min(best, std::max(error.At(x, y), floor));
  float total = 0;
  for (size_t i = 0; i < errors.size(); ++i) {
    const float error = std::max(errors[i].At(x, y), floor);
    const float ratio = error > best ? best / error : 1.0f;
    const float share = ratio * ratio * (ratio * ratio);
    (*shares)[i].At(x, y) = share;
    total += share;
  }
  for (Plane& share : *shares) share.At(x, y) /= total;
}

}  // namespace

Planes SelectCandidates(const Halves& halves, const Planes& raw_variance,
                        const std::vector<Candidate>& candidates, const SelectionParams& params,
                        TaskPool* pool) {
  const Plane mask = MeasurableMask(halves);
  Planes errors;
  errors.push_back(Smooth(RawError(raw_variance, pool), mask, params, pool));
  for (const Candidate& candidate : candidates) {
    errors.push_back(Smooth(CandidateError(halves, candidate, pool), mask, params, pool));
  }
  Planes chosen = MakePlanes(errors.size(), halves.width(), halves.height());
  ForEachBand(pool, halves.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < halves.width(); ++x) ShareOut(errors, x, y, &chosen);
    }
  });
  Planes shares;
  for (const Plane& plane : chosen)
    shares.push_back(BoxMean(plane.view(), halves.weight.view(), params.blend_radius, pool));
  return shares;
}

}  // namespace lumifold::filter
