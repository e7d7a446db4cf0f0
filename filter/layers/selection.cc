#include "filter/layers/selection.h"

#include <algorithm>
#include <cmath>

#include "filter/kernels/box_mean.h"
#include "filter/kernels/row_kernels.h"
#include "filter/layers/error_weight.h"

namespace lumifold::filter {
namespace {

/// Errors below this part of the noisy layer's own count as this much.
constexpr float kLeastError = 0.01f;

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
        CandidateErrorRow(halves.a[c].Row(y), halves.b[c].Row(y), candidate.a[c].Row(y),
                          candidate.b[c].Row(y), error.width(), error.Row(y));
      }
    }
  });
  return error;
}

/// The light of a row over its mean, with little noise: that of the picture, or of `first`, the first
/// candidate.
void LightRow(const Halves& halves, const Candidate& first, int y, std::vector<float>* light) {
  if (halves.picture_light.width() > 0) {
    std::copy_n(halves.picture_light.Row(y), light->size(), light->begin());
    return;
  }
  std::fill(light->begin(), light->end(), 0.0f);
  const float share = 1.0f / (6.0f * halves.level);
  for (const Planes* half : {&first.a, &first.b}) {
    for (const Plane& channel : *half) {
      const float* __restrict in = channel.Row(y);
      for (size_t x = 0; x < light->size(); ++x) (*light)[x] += share * std::abs(in[x]);
    }
  }
}

void WeightErrors(const Halves& halves, const Candidate& first, TaskPool* pool, Planes* errors) {
  ForEachBand(pool, halves.height(), [&](int, int y0, int y1) {
    std::vector<float> light(static_cast<size_t>(halves.width()));
    for (int y = y0; y < y1; ++y) {
      LightRow(halves, first, y, &light);
      for (float& value : light) value = ErrorWeight(value);
      for (Plane& error : *errors) {
        float* __restrict row = error.Row(y);
        for (size_t x = 0; x < light.size(); ++x) row[x] *= light[x];
      }
    }
  });
}

Planes Smooth(const Planes& errors, const Plane& mask, const SelectionParams& params, TaskPool* pool) {
  Planes smooth = BoxMeans(errors, mask.view(), params.error_radius, pool);
  const Planes region = BoxMeans(errors, mask.view(), params.region_radius, pool);
  ForEachBand(pool, mask.height(), [&](int, int y0, int y1) {
    for (size_t i = 0; i < smooth.size(); ++i) {
      for (int y = y0; y < y1; ++y) {
        const float* __restrict wide = region[i].Row(y);
        float* __restrict out = smooth[i].Row(y);
        for (int x = 0; x < mask.width(); ++x) out[x] += params.region_share * (wide[x] - out[x]);
      }
    }
  });
  return smooth;
}

/// Shares of one pixel: proportional to the fourth power of the inverse error, so that the best candidate has
/// nearly all unless others are as good, and rounding never changes the picture visibly.
void SetShares(const Planes& errors, int x, int y, Planes* shares) {
  const float floor =
      kLeastError * errors[0].At(x, y);  // estimates of small errors are noisy and may be negative
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

int SelectionWindow(const SelectionParams& params) {
  return std::max(params.error_radius, params.region_radius) + params.blend_radius;
}

Planes SelectCandidates(const Halves& halves, const Planes& raw_variance,
                        const std::vector<const Candidate*>& candidates, const SelectionParams& params,
                        TaskPool* pool) {
  const Plane mask = BothHalvesMask(halves);
  Planes estimates;
  estimates.push_back(RawError(raw_variance, pool));
  for (const Candidate* candidate : candidates) estimates.push_back(CandidateError(halves, *candidate, pool));
  WeightErrors(halves, *candidates.front(), pool, &estimates);
  const Planes errors = Smooth(estimates, mask, params, pool);
  Planes chosen = MakePlanes(errors.size(), halves.width(), halves.height());
  ForEachPixel(pool, halves.width(), halves.height(),
               [&](int x, int y) { SetShares(errors, x, y, &chosen); });
  return BoxMeans(chosen, halves.weight.view(), params.blend_radius, pool);
}

}  // namespace lumifold::filter
