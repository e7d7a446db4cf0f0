#include "filter/baselines/a_trous.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "absl/functional/function_ref.h"
#include "filter/image/color.h"
#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "filter/kernels/box_mean.h"
#include "filter/layers/features.h"
#include "filter/layers/filter_layers.h"

namespace lumifold::filter {
namespace {

constexpr int kRounds = 5;
constexpr std::array<float, 5> kKernel = {1.0f / 16, 4.0f / 16, 6.0f / 16, 4.0f / 16, 1.0f / 16};
constexpr int kVarianceRadius = 3;
constexpr float kLeastDeviation = 1e-4f;  // of luminance about 1
constexpr size_t kDepthFeature = 3;

struct Pixel {
  int x = 0;
  int y = 0;
};

/// Weight of q in the filtered value of p, without the kernel's tap.
using TapWeight = absl::FunctionRef<float(Pixel p, Pixel q)>;

/// One pixel of one iteration. Planes after the first three are variances, which get the squared weights.
void FilterPixel(const Planes& in, ConstFloatView mask, Pixel p, int step, TapWeight weight, Planes* out) {
  std::array<float, 4> sums = {};
  float total = 0;
  for (int j = 0; j < 5; ++j) {
    for (int i = 0; i < 5; ++i) {
      const Pixel q = {p.x + (i - 2) * step, p.y + (j - 2) * step};
      if (q.x < 0 || q.y < 0 || q.x >= mask.width() || q.y >= mask.height()) continue;
      if (mask.At(q.x, q.y) == 0) continue;
      const bool is_center = i == 2 && j == 2;
      const float w = kKernel[static_cast<size_t>(i)] * kKernel[static_cast<size_t>(j)] * mask.At(q.x, q.y) *
                      (is_center ? 1.0f : weight(p, q));
      total += w;
      for (size_t c = 0; c < in.size(); ++c) sums[c] += (c < 3 ? w : w * w) * in[c].At(q.x, q.y);
    }
  }
  for (size_t c = 0; c < in.size(); ++c) {
    const float norm = c < 3 ? total : total * total;
    (*out)[c].At(p.x, p.y) = norm > 0 ? sums[c] / norm : in[c].At(p.x, p.y);
  }
}

Planes FilterRound(const Planes& in, ConstFloatView mask, int step, TapWeight weight, TaskPool* pool) {
  Planes out = MakePlanes(in.size(), mask.width(), mask.height());
  ParallelFor(pool, mask.height(), [&](int64_t row) {
    for (int x = 0; x < mask.width(); ++x)
      FilterPixel(in, mask, {x, static_cast<int>(row)}, step, weight, &out);
  });
  return out;
}

float SquaredDistance(const Planes& planes, size_t first, size_t last, Pixel p, Pixel q) {
  float sum = 0;
  for (size_t k = first; k < last; ++k) {
    const float difference = planes[k].At(p.x, p.y) - planes[k].At(q.x, q.y);
    sum += difference * difference;
  }
  return sum;
}

Picture FilterPlain(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const float phi_normal = values[1] / (kSigmaNormal * kSigmaNormal);  // of the feature squared
  const float sigma_depth = values[2] / kSigmaLogDepth;
  const auto filter_layer = [&](const Halves& halves, const Planes& geometry) {
    Planes light = Combine(halves.a, halves.b, halves.share_a.view(), pool);
    for (int round = 0; round < kRounds; ++round) {
      const int step = 1 << round;
      const float sigma_color = values[0] / static_cast<float>(step);
      const float square_step = static_cast<float>(step * step);
      const auto weight = [&](Pixel p, Pixel q) {
        const float color = SquaredDistance(light, 0, 3, p, q) / (sigma_color * sigma_color);
        const float normal = SquaredDistance(geometry, 0, kDepthFeature, p, q) / (square_step * phi_normal);
        const float rest =
            SquaredDistance(geometry, kDepthFeature, geometry.size(), p, q) / (sigma_depth * sigma_depth);
        return Exp(-(color + normal + rest));
      };
      light = FilterRound(light, halves.weight.view(), step, weight, pool);
    }
    return light;
  };
  return FilterLayers(film.pixels, filter_layer, pool);
}

/// The variance of the luminance of the halves' mean, averaged over a window.
Plane LuminanceVariance(const Halves& halves, TaskPool* pool) {
  Planes variance = MakePlanes(1, halves.width(), halves.height());
  ForEachPixel(halves.width(), halves.height(), [&](int x, int y) {
    const float difference = LuminanceAt(halves.a, x, y) - LuminanceAt(halves.b, x, y);
    const float share = halves.share_a.At(x, y);
    variance[0].At(x, y) = share * (1.0f - share) * difference * difference;
  });
  return std::move(BoxMeans(variance, halves.weight.view(), kVarianceRadius, pool)[0]);
}

/// 3x3 Gaussian, clamped at the edges.
Plane Smooth(const Plane& plane, TaskPool* pool) {
  constexpr std::array<float, 3> kTaps = {0.25f, 0.5f, 0.25f};
  Plane smooth(plane.width(), plane.height());
  ParallelFor(pool, plane.height(), [&](int64_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < plane.width(); ++x) {
      float sum = 0;
      for (int j = -1; j <= 1; ++j) {
        for (int i = -1; i <= 1; ++i) {
          sum += kTaps[static_cast<size_t>(i + 1)] * kTaps[static_cast<size_t>(j + 1)] *
                 plane.At(std::clamp(x + i, 0, plane.width() - 1), std::clamp(y + j, 0, plane.height() - 1));
        }
      }
      smooth.At(x, y) = sum;
    }
  });
  return smooth;
}

/// x^128 for x in [0, 1].
float PowerOf128(float x) {
  for (int i = 0; i < 7; ++i) x *= x;
  return x;
}

Picture FilterGuidedByVariance(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const float sigma_luminance = values[0];
  const float sigma_depth = values[1] / kSigmaLogDepth;
  const auto filter_layer = [&](const Halves& halves, const Planes& geometry) {
    Planes light = Combine(halves.a, halves.b, halves.share_a.view(), pool);
    light.push_back(LuminanceVariance(halves, pool));
    for (int round = 0; round < kRounds; ++round) {
      const int step = 1 << round;
      const Plane variance = Smooth(light[3], pool);
      const auto weight = [&](Pixel p, Pixel q) {
        const float deviation = std::sqrt(variance.At(p.x, p.y));
        const float luminance = std::abs(LuminanceAt(light, p.x, p.y) - LuminanceAt(light, q.x, q.y)) /
                                (sigma_luminance * deviation + kLeastDeviation);
        const float square_chord =
            kSigmaNormal * kSigmaNormal * SquaredDistance(geometry, 0, kDepthFeature, p, q);
        const float cosine = std::max(0.0f, 1.0f - 0.5f * square_chord);
        const float rest = SquaredDistance(geometry, kDepthFeature, geometry.size(), p, q);
        const float depth = std::sqrt(rest) / (sigma_depth * static_cast<float>(step));
        return PowerOf128(cosine) * Exp(-(luminance + depth));
      };
      light = FilterRound(light, halves.weight.view(), step, weight, pool);
    }
    light.pop_back();
    return light;
  };
  return FilterLayers(film.pixels, filter_layer, pool);
}

}  // namespace

Baseline ATrousBaseline() {
  return {
      .info = {.name = "a-trous",
               .summary = "edge-avoiding a-trous wavelets on each layer of light",
               .source = "Dammertz et al. 2010",
               .parameters =
                   {{"sigma_c",
                     "range of light over the layer's mean, halved each round",
                     0.6f,
                     {0.3f, 0.6f, 1.2f, 2.4f},
                     1e-3f,
                     1e3f},
                    {"phi_n", "range of the squared difference of normals", 0.3f, {0.1f, 0.3f}, 1e-3f, 10},
                    {"sigma_z", "range of relative depth", 0.05f, {0.05f}, 1e-3f, 10}}},
      .filter = FilterPlain};
}

Baseline ATrousVarianceBaseline() {
  return {
      .info =
          {.name = "a-trous-variance",
           .summary = "a-trous wavelets on each layer of light, guided by its variance (SVGF's spatial part)",
           .source = "Schied et al. 2017",
           .parameters = {{"sigma_l", "range of luminance over its deviation", 4, {1, 2, 4, 8}, 1e-2f, 1e3f},
                          {"sigma_z", "range of relative depth a pixel", 0.02f, {0.005f, 0.02f}, 1e-4f, 10}}},
      .filter = FilterGuidedByVariance};
}

}  // namespace lumifold::filter
