#include "filter/baselines/bilateral.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/baselines/display_color.h"
#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "filter/layers/features.h"
#include "filter/layers/filter_layers.h"
#include "filter/layers/guide.h"
#include "filter/manifold/nlm_space.h"

namespace lumifold::filter {
namespace {

constexpr float kRadiusOverSigma = 2.5f;

/// Accumulates the weighted sums of one row of pixels, one offset at a time.
class RowSum {
 public:
  RowSum(const Planes& signals, const Planes& features, ConstFloatView mask)
      : signals_(signals),
        features_(features),
        mask_(mask),
        weights_(static_cast<size_t>(mask.width())),
        sums_(signals.size() + 1, std::vector<float>(weights_.size())) {}

  void Clear() {
    for (std::vector<float>& sum : sums_) std::fill(sum.begin(), sum.end(), 0.0f);
  }

  void Add(int y, int from, int dx, float spatial) {
    const int x0 = std::max(0, -dx);
    const int x1 = std::min(mask_.width(), mask_.width() - dx);
    float* __restrict w = weights_.data();
    for (int x = x0; x < x1; ++x) w[x] = 0.0f;
    for (const Plane& feature : features_) {
      const float* __restrict u = feature.Row(y);
      const float* __restrict v = feature.Row(from) + dx;
      for (int x = x0; x < x1; ++x) w[x] += (u[x] - v[x]) * (u[x] - v[x]);
    }
    const float* __restrict m = mask_.Row(from) + dx;
    for (int x = x0; x < x1; ++x) w[x] = m[x] * Exp(spatial - 0.5f * w[x]);
    for (size_t c = 0; c < signals_.size(); ++c) {
      const float* __restrict f = signals_[c].Row(from) + dx;
      float* __restrict sum = sums_[c].data();
      for (int x = x0; x < x1; ++x) sum[x] += w[x] * f[x];
    }
    float* __restrict den = sums_.back().data();
    for (int x = x0; x < x1; ++x) den[x] += w[x];
  }

  void Write(int y, Planes* out) const {
    const std::vector<float>& den = sums_.back();
    for (size_t c = 0; c < signals_.size(); ++c) {
      for (int x = 0; x < mask_.width(); ++x) {
        const auto i = static_cast<size_t>(x);
        (*out)[c].At(x, y) = den[i] > 0 ? sums_[c][i] / den[i] : signals_[c].At(x, y);
      }
    }
  }

 private:
  const Planes& signals_;
  const Planes& features_;
  ConstFloatView mask_;
  std::vector<float> weights_;
  std::vector<std::vector<float>> sums_;
};

Picture FilterColor(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const Planes color = DisplayColor(film.pixels, pool);
  Planes guide = MakePlanes(3, color[0].width(), color[0].height());
  Plane mask = MakePlane(color[0].width(), color[0].height(), 1.0f);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(mask.width(), mask.height(),
                 [&](int x, int y) { guide[c].At(x, y) = color[c].At(x, y) / values[1]; });
  }
  return LinearColor(BilateralFilter(color, guide, mask.view(), values[0], pool), pool);
}

Planes CrossGuide(const Halves& halves, const Planes& mean, const Planes& geometry, float sigma_q,
                  TaskPool* pool) {
  if (sigma_q > 0) {
    const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), PatchParams{}, pool);
    return JointFeatures(MakeJointGuide(Clone(mean), basis, sigma_q * PositiveNoise(halves, pool), geometry),
                         pool);
  }
  return Clone(geometry);
}

Picture FilterLight(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const auto filter_layer = [&](const Halves& halves, const Planes& geometry) {
    const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), pool);
    const Planes guide = CrossGuide(halves, mean, geometry, values[1], pool);
    return BilateralFilter(mean, guide, halves.weight.view(), values[0], pool);
  };
  return FilterLayers(film.pixels, filter_layer, pool);
}

}  // namespace

Planes BilateralFilter(const Planes& signals, const Planes& features, ConstFloatView mask, float sigma_s,
                       TaskPool* pool) {
  const int height = mask.height();
  const int radius = static_cast<int>(std::ceil(kRadiusOverSigma * sigma_s));
  const float falloff = -0.5f / (sigma_s * sigma_s);
  Planes out = MakePlanes(signals.size(), mask.width(), height);
  ParallelFor(pool, height, [&](int64_t row) {
    const int y = static_cast<int>(row);
    RowSum sum(signals, features, mask);
    sum.Clear();
    for (int dy = std::max(-radius, -y); dy <= std::min(radius, height - 1 - y); ++dy) {
      for (int dx = -radius; dx <= radius; ++dx)
        sum.Add(y, y + dy, dx, falloff * static_cast<float>(dx * dx + dy * dy));
    }
    sum.Write(y, &out);
  });
  return out;
}

Baseline BilateralBaseline() {
  return {
      .info =
          {.name = "bilateral",
           .summary = "bilateral filter on the finished colours",
           .source = "Tomasi & Manduchi 1998",
           .parameters =
               {{"sigma_s", "reach in pixels", 8, {2, 4, 8}, 0.5f, 32},
                {"sigma_r", "range of displayed colour", 0.15f, {0.05f, 0.1f, 0.15f, 0.3f, 0.6f}, 0.01f, 10}},
           .uses_auxiliary = false},
      .filter = FilterColor};
}

Baseline CrossBilateralBaseline() {
  return {.info = {.name = "cross-bilateral",
                   .summary = "bilateral filter on each layer of light, guided by normals, depth and patches",
                   .source = "Petschnigg et al. 2004; features of Gruzdev et al. 2015",
                   .parameters = {{"sigma_s", "reach in pixels", 8, {4, 8}, 0.5f, 32},
                                  {"sigma_q",
                                   "range of the layer's patches over its noise; 0: geometry alone",
                                   1.8f,
                                   {0, 0.9f, 1.8f},
                                   0,
                                   100}}},
          .filter = FilterLight};
}

}  // namespace lumifold::filter
