#include "filter/denoise/firefly.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "filter/image/mix_bits.h"
#include "filter/kernels/box_mean.h"
#include "filter/layers/features.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/returned_energy.h"

namespace lumifold::filter {
namespace {

constexpr size_t kMinNeighbours = 4;

/// The bound, from the valid pixels of the window: a quantile times `excess`; infinity where there are too
/// few. Where most of them are black, as in rare light, the quantile tells nothing, and the mean of the
/// neighbours takes its place. `luminance`: from PaddedLuminance().
float BoundAt(const Plane& luminance, const FireflyParams& params, float excess, int x, int y,
              std::vector<float>* values) {
  values->clear();
  for (int j = 0; j <= 2 * params.radius; ++j) {
    for (int i = 0; i <= 2 * params.radius; ++i) {
      const float value = luminance.At(x + i, y + j);
      if (value < INFINITY) values->push_back(value);
    }
  }
  if (values->size() < kMinNeighbours) return INFINITY;
  const auto below = static_cast<std::ptrdiff_t>(params.quantile * static_cast<float>(values->size()));
  std::nth_element(values->begin(), values->begin() + below, values->end());
  const float quantile = (*values)[static_cast<size_t>(below)];
  if (quantile > 0) return excess * quantile;
  const float others = std::accumulate(values->begin(), values->end(), 0.0f) -
                       luminance.At(x + params.radius, y + params.radius);
  return excess * std::max(0.0f, others) / static_cast<float>(values->size() - 1);
}

/// For each pixel of a row: whether `brighter[x]`, the luminance of the brighter half, is above BoundAt():
/// the part `quantile` of the valid neighbours times `excess[x]` is below it. `luminance`: from
/// PaddedLuminance().
void FindOutliers(const Plane& luminance, const FireflyParams& params, const std::vector<float>& brighter,
                  const std::vector<float>& excess, int y, std::vector<uint8_t>* is_outlier) {
  const size_t width = brighter.size();
  std::vector<int32_t> below(width, 0);
  std::vector<int32_t> valid(width, 0);
  for (int j = 0; j <= 2 * params.radius; ++j) {
    for (int i = 0; i <= 2 * params.radius; ++i) {
      const float* __restrict neighbour = luminance.Row(y + j) + i;
      for (size_t x = 0; x < width; ++x) {
        below[x] += excess[x] * neighbour[x] < brighter[x] ? 1 : 0;
        valid[x] += neighbour[x] < INFINITY ? 1 : 0;
      }
    }
  }
  for (size_t x = 0; x < width; ++x) {
    const auto least = static_cast<int32_t>(params.quantile * static_cast<float>(valid[x]));
    (*is_outlier)[x] = below[x] > least ? 1 : 0;
  }
}

/// Luminance of `color` with an apron on all sides; infinite where `weight` is 0 and in the apron.
Plane PaddedLuminance(const Planes& color, const Plane& weight, int apron, TaskPool* pool) {
  Plane padded(weight.width() + 2 * apron, weight.height() + 2 * apron);
  padded.Fill(INFINITY);
  ForEachBand(pool, weight.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      float* row = padded.Row(y + apron) + apron;
      for (int x = 0; x < weight.width(); ++x) {
        if (weight.At(x, y) > 0) row[x] = LuminanceAt(color, x, y);
      }
    }
  });
  return padded;
}

/// Standard deviation of one half relative to its light, around each pixel. The ratio of the halves'
/// difference to their sum is bounded, so that no pixel dominates the mean.
Plane RelativeNoise(const Halves& halves, int radius, TaskPool* pool) {
  Planes square = MakePlanes(1, halves.width(), halves.height());
  ForEachPixel(pool, halves.width(), halves.height(), [&](int x, int y) {
    const float a = LuminanceAt(halves.a, x, y);
    const float b = LuminanceAt(halves.b, x, y);
    const float ratio = (a - b) / (a + b);
    if (ratio >= -1 && ratio <= 1) square[0].At(x, y) = 2 * ratio * ratio;
  });
  Plane noise = std::move(BoxMeans(square, halves.weight.view(), radius, pool)[0]);
  ForEachPixel(noise.width(), noise.height(),
               [&](int x, int y) { noise.At(x, y) = std::sqrt(noise.At(x, y)); });
  return noise;
}

/// Whether `excess` times the luminance of each valid neighbour is below that of the pixel. `luminance`: from
/// PaddedLuminance().
bool IsIsolated(const Plane& luminance, const FireflyParams& params, float excess, int x, int y) {
  const float most = luminance.At(x + params.radius, y + params.radius) / excess;
  for (int j = 0; j <= 2 * params.radius; ++j) {
    for (int i = 0; i <= 2 * params.radius; ++i) {
      const float value = luminance.At(x + i, y + j);
      if (value < INFINITY && value > most && (i != params.radius || j != params.radius)) return false;
    }
  }
  return true;
}

/// What is known of an outlier.
struct Outlier {
  float bound = 0;
  float noise = 0;  // deviation of one half over its light that can explain what both halves show; 0: none
};

/// Scales the half's pixel to the bound if it is above it and noise explains why: the other half shows less
/// than half of the excess, or the noise is that large. Keeps what the pixel loses in `removed`.
bool Suppress(Planes* half, float other, const Outlier& outlier, float sigmas, int x, int y,
              Planes* removed) {
  const float luminance = LuminanceAt(*half, x, y);
  const float bound = outlier.bound;
  if (!(luminance > bound) || !(bound >= 0)) return false;
  const bool is_contradicted = other < 0.5f * (bound + luminance);
  const bool is_noise = luminance * (1.0f - sigmas * outlier.noise) < bound;
  if (!is_contradicted && !is_noise) return false;
  const float keep = bound / luminance;
  for (size_t c = 0; c < 3; ++c) {
    float& value = (*half)[c].At(x, y);
    (*removed)[c].At(x, y) = (1.0f - keep) * value;
    value *= keep;
  }
  return true;
}

/// What half h of the film brings to channel c of each pixel of C, as `removed` and what is left of the half
/// tell, and its fragments where there are some.
Plane NoisyProduct(const Product& product, const LayerFragments& fragments, const Halves& halves, size_t h,
                   size_t c, const Plane& removed, TaskPool* pool) {
  const Rect& box = product.box;
  const bool has_factor = !product.factor_of[h][0].IsEmpty();
  Plane noisy(box.width(), box.height());
  ForEachPixel(pool, box.width(), box.height(), [&](int x, int y) {
    const float factor = has_factor ? product.factor_of[h][c].At(box.x0 + x, box.y0 + y) : 1.0f;
    const float before = removed.At(x, y) + HalfOf(halves, h)[c].At(x, y);
    noisy.At(x, y) = before * halves.scale * product.validity.At(x, y) * factor;
  });
  for (const LayerFragments::Pixel& pixel : fragments.pixels)
    noisy.At(pixel.x, pixel.y) = fragments.Noisy(pixel, h, c);
  return noisy;
}

}  // namespace

std::array<Planes, 2> SuppressFireflies(const FireflyParams& params, int noise_radius, Halves* halves,
                                        TaskPool* pool) {
  if (!halves->has_noise_estimate || halves->is_difference) return {};
  const int width = halves->width();
  const int height = halves->height();
  const Planes mean = Combine(halves->a, halves->b, halves->share_a.view(), pool);
  const Plane luminance = PaddedLuminance(mean, halves->weight, params.radius, pool);
  const Plane noise = RelativeNoise(*halves, noise_radius, pool);
  std::array<Planes, 2> removed = {MakePlanes(3, width, height), MakePlanes(3, width, height)};
  std::atomic<bool> is_any{false};
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    bool is_any_here = false;
    std::vector<float> brighter(static_cast<size_t>(width));
    std::vector<float> excess(brighter.size());
    std::vector<uint8_t> is_outlier(brighter.size());
    std::vector<float> window;
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < width; ++x) {
        const auto i = static_cast<size_t>(x);
        brighter[i] = std::max(LuminanceAt(halves->a, x, y), LuminanceAt(halves->b, x, y));
        excess[i] = std::max(params.excess, 1.0f + params.excess * noise.At(x, y));
      }
      FindOutliers(luminance, params, brighter, excess, y, &is_outlier);
      for (int x = 0; x < width; ++x) {
        const auto i = static_cast<size_t>(x);
        if (is_outlier[i] == 0 || halves->weight_a.At(x, y) * halves->weight_b.At(x, y) == 0) continue;
        // Where both halves have hit a firefly they hardly differ; the window around shows the noise.
        const Outlier outlier = {BoundAt(luminance, params, excess[i], x, y, &window),
                                 IsIsolated(luminance, params, excess[i], x, y) ? noise.At(x, y) : 0.0f};
        const float a = LuminanceAt(halves->a, x, y);
        const float b = LuminanceAt(halves->b, x, y);
        is_any_here |= Suppress(&halves->a, b, outlier, params.sigmas, x, y, &removed[0]);
        is_any_here |= Suppress(&halves->b, a, outlier, params.sigmas, x, y, &removed[1]);
      }
    }
    if (is_any_here) is_any = true;
  });
  return is_any ? std::move(removed) : std::array<Planes, 2>{};
}

std::array<Planes, 2> TakeMissing(const Product& product, const LayerFragments& fragments,
                                  const Halves& halves, TaskPool* pool, std::array<Planes, 2>* removed) {
  if ((*removed)[0].empty() || product.rest_of[0][0].IsEmpty()) return {};
  const Rect& box = product.box;
  std::array<Planes, 2> missing;
  for (size_t h = 0; h < 2; ++h) {
    missing[h] = MakePlanes(3, box.width(), box.height());
    for (size_t c = 0; c < 3; ++c) {
      const Plane noisy = NoisyProduct(product, fragments, halves, h, c, (*removed)[h][c], pool);
      ForEachPixel(pool, box.width(), box.height(), [&](int x, int y) {
        float& of_half = (*removed)[h][c].At(x, y);
        const float rest = product.rest_of[h][c].At(box.x0 + x, box.y0 + y);
        if (!(of_half > 0) || !(rest < 0)) return;
        const float part = of_half / (of_half + HalfOf(halves, h)[c].At(x, y));
        const float in_c = part * noisy.At(x, y);
        if (!(in_c > 0) || !IsUsable(in_c)) return;
        const float by = std::min(in_c, -rest);
        missing[h][c].At(x, y) = by;
        of_half *= (in_c - by) / in_c;
      });
    }
  }
  return missing;
}

namespace {

/// What ReturnRemoved() knows of one half's energy around each pixel.
struct Spread {
  Planes energy;     // 3: local mean of the energy removed
  Plane with_signs;  // local mean of its luminance, each pixel's with a sign of its own
};

/// 1 or -1, as if by chance.
float SignOf(int x, int y) {
  const uint64_t pixel = static_cast<uint64_t>(y) << 32 | static_cast<uint64_t>(x);
  return MixBits(pixel + 1) % 2 == 0 ? 1.0f : -1.0f;
}

std::array<Spread, 2> SpreadAround(const std::array<Planes, 2>& removed, const Planes& guide,
                                   ConstFloatView weight, const ManifoldParams& manifolds, TaskPool* pool) {
  Planes signals;
  for (const Planes& half : removed) {
    for (const Plane& channel : half) signals.push_back(channel.Clone());
    Plane& with_signs = signals.emplace_back(weight.width(), weight.height());
    ForEachPixel(pool, weight.width(), weight.height(),
                 [&](int x, int y) { with_signs.At(x, y) = SignOf(x, y) * LuminanceAt(half, x, y); });
  }
  Planes filtered = ManifoldFilter(signals, guide, weight, manifolds, pool);
  std::array<Spread, 2> spread;
  for (size_t h = 0; h < 2; ++h) {
    for (size_t c = 0; c < 3; ++c) spread[h].energy.push_back(std::move(filtered[4 * h + c]));
    spread[h].with_signs = std::move(filtered[4 * h + 3]);
  }
  return spread;
}

/// 1 - (signed sum / sum)^2. The square of a sum with random signs is that of its terms on average, so this
/// is 1 - 1/n of n equal terms, however the terms are weighted; it is 0 of one term alone.
float SharedPart(float sum, float signed_sum) {
  const float ratio = signed_sum / sum;
  return ratio > -1 && ratio < 1 ? 1.0f - ratio * ratio : 0.0f;
}

/// The mean of both halves' values at a pixel.
float MeanOfHalves(const Halves& halves, int x, int y, float a, float b) {
  const float share = halves.share_a.At(x, y);
  return share * a + (1.0f - share) * b;
}

/// Sum over all pixels, weighted.
double Total(const Plane& plane, ConstFloatView weight, TaskPool* pool) {
  return SumRows(pool, plane.height(), [&](int y) {
    double sum = 0;
    for (int x = 0; x < plane.width(); ++x)
      sum += static_cast<double>(weight.At(x, y)) * static_cast<double>(plane.At(x, y));
    return sum;
  });
}

/// SharedPartOfAll() of the layer's outliers.
float PartOfAll(const std::array<Planes, 2>& removed, const Halves& halves, TaskPool* pool) {
  const ConstFloatView weight = halves.weight.view();
  Plane square(weight.width(), weight.height());
  Plane luminance(weight.width(), weight.height());
  ForEachPixel(pool, weight.width(), weight.height(), [&](int x, int y) {
    const float mean =
        MeanOfHalves(halves, x, y, LuminanceAt(removed[0], x, y), LuminanceAt(removed[1], x, y));
    luminance.At(x, y) = mean;
    square.At(x, y) = mean * mean;
  });
  return SharedPartOfAll(Total(luminance, weight, pool), Total(square, weight, pool));
}

/// Adds `part` of what is not returned nearby to all light in proportion.
void ReturnRest(const Planes& removed, const Planes& light, float part, ConstFloatView weight, TaskPool* pool,
                Planes* energy) {
  for (size_t c = 0; c < 3; ++c) {
    const std::optional<float> gain =
        GainOfRest(part, Total(removed[c], weight, pool), Total((*energy)[c], weight, pool),
                   Total(light[c], weight, pool));
    if (!gain.has_value()) continue;
    ForEachPixel(pool, weight.width(), weight.height(),
                 [&](int x, int y) { (*energy)[c].At(x, y) += *gain * std::max(0.0f, light[c].At(x, y)); });
  }
}

}  // namespace

std::array<Planes, 2> ReturnRemoved(const std::array<Planes, 2>& removed, const Planes& light,
                                    const Halves& halves, const Planes& geometry, float knee, float reach_px,
                                    const FireflyParams& params, TaskPool* pool) {
  const ConstFloatView weight = halves.weight.view();
  Planes guide = Clone(geometry);
  for (const Plane& channel : Stabilise(light, knee * halves.level, halves.level, pool))
    AppendFeature(channel.view(), params.spread_light, weight, &guide);
  std::array<Spread, 2> spread =
      SpreadAround(removed, guide, weight, {.sigma_s = reach_px, .height = params.spread_height}, pool);
  ForEachPixel(pool, weight.width(), weight.height(), [&](int x, int y) {
    const float sum =
        MeanOfHalves(halves, x, y, LuminanceAt(spread[0].energy, x, y), LuminanceAt(spread[1].energy, x, y));
    const float signed_sum =
        MeanOfHalves(halves, x, y, spread[0].with_signs.At(x, y), spread[1].with_signs.At(x, y));
    const float part = SharedPart(sum, signed_sum);
    for (Spread& half : spread) {
      for (Plane& channel : half.energy) channel.At(x, y) *= part;
    }
  });
  const float part = PartOfAll(removed, halves, pool);
  for (size_t h = 0; h < 2; ++h) ReturnRest(removed[h], light, part, weight, pool, &spread[h].energy);
  return {std::move(spread[0].energy), std::move(spread[1].energy)};
}

}  // namespace lumifold::filter
