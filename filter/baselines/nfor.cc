#include "filter/baselines/nfor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>

#include "filter/baselines/noisy_halves.h"
#include "filter/baselines/non_local_means.h"
#include "filter/baselines/patch_regression.h"
#include "filter/baselines/standardise.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"

namespace lumifold::filter {
namespace {

constexpr std::array<std::string_view, 4> kGeometry = {layers::kNormalX, layers::kNormalY, layers::kNormalZ,
                                                       layers::kDistance};

/// The filter of the maps of errors and choices.
constexpr NonLocalMeansParams kMapSmoothing = {.search_radius = 9, .patch_radius = 1, .strength = 1};

/// Features of 1e6 and more are taken for defects of the film.
constexpr float kLargestFeature = 999999.9375f;

/// A channel of the first surface and of the surfaces seen in it, each weighted by the fraction of the pixel
/// it covers. The fraction without a surface that has a diffuse lobe gets the first surface's value.
Plane SeenGeometry(const LayeredImage& film, std::string_view channel) {
  Plane seen(film.width(), film.height());
  Plane rest = MakePlane(film.width(), film.height(), 1.0f);
  const auto add = [&](ConstFloatView value, ConstFloatView mask) {
    ForEachPixel(film.width(), film.height(), [&](int x, int y) {
      const float share =
          std::clamp(UsableOr0(mask.At(x, y), kLargestFeature), 0.0f, std::max(0.0f, rest.At(x, y)));
      seen.At(x, y) += share * UsableOr0(value.At(x, y), kLargestFeature);
      rest.At(x, y) -= share;
    });
  };
  add(film.Get(channel), film.Get(layers::kMask));
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    const layers::Level level = layers::Level::Of(i);
    const std::string mask = layers::OfLevel(level, layers::kMask);
    if (film.Has(mask)) add(film.Get(layers::OfLevel(level, channel)), film.Get(mask));
  }
  add(film.Get(channel), Plane(rest.Clone()).view());
  return seen;
}

/// The sum of T of the first surface and of the surfaces seen in it.
Plane SeenAlbedo(const LayeredImage& film, size_t component) {
  Plane seen(film.width(), film.height());
  const auto add = [&](ConstFloatView albedo) {
    ForEachPixel(film.width(), film.height(),
                 [&](int x, int y) { seen.At(x, y) += UsableOr0(albedo.At(x, y), kLargestFeature); });
  };
  add(film.GetColor(layers::kAlbedo)[component]);
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    const std::string layer = layers::OfLevel(layers::Level::Of(i), layers::kAlbedo);
    if (film.HasColor(layer)) add(film.GetColor(layer)[component]);
  }
  return seen;
}

Planes Features(const LayeredImage& film, TaskPool* pool) {
  Planes features;
  for (const std::string_view channel : kGeometry) features.push_back(SeenGeometry(film, channel));
  for (size_t c = 0; c < 3; ++c) features.push_back(SeenAlbedo(film, c));
  Plane everywhere = MakePlane(film.width(), film.height(), 1.0f);
  return Standardise(features, everywhere.view(), true, pool, nullptr);
}

/// out = value(x, y) for each of three planes.
template <typename Value>
Planes ForEachValue(int width, int height, TaskPool* pool, Value value) {
  Planes out = MakePlanes(3, width, height);
  ForEachPixel(pool, width, height, [&](int x, int y) {
    for (size_t c = 0; c < 3; ++c) out[c].At(x, y) = value(c, x, y);
  });
  return out;
}

float Square(float x) { return x * x; }

Planes MeanOf(const Planes& a, const Planes& b, TaskPool* pool) {
  return ForEachValue(a[0].width(), a[0].height(), pool,
                      [&](size_t c, int x, int y) { return 0.5f * (a[c].At(x, y) + b[c].At(x, y)); });
}

/// Both halves, fitted.
struct FittedHalves {
  Planes a;
  Planes b;
};

FittedHalves FitHalves(const Halves& halves, const Planes& variance, const Planes& features, float strength,
                       TaskPool* pool) {
  return {PatchRegression({halves.a, halves.b, variance, features, strength}, pool),
          PatchRegression({halves.b, halves.a, variance, features, strength}, pool)};
}

/// Estimated squared error of the mean of the fitted halves, from the difference of each to the other half's
/// input.
Planes EstimatedError(const Halves& halves, const Planes& variance, const FittedHalves& fitted,
                      TaskPool* pool) {
  return ForEachValue(halves.width(), halves.height(), pool, [&](size_t c, int x, int y) {
    const float a = Square(halves.b[c].At(x, y) - fitted.a[c].At(x, y));
    const float b = Square(halves.a[c].At(x, y) - fitted.b[c].At(x, y));
    const float residual = 0.25f * Square(fitted.a[c].At(x, y) - fitted.b[c].At(x, y));
    return 0.5f * (a + b) - variance[c].At(x, y) - residual;
  });
}

/// 1 where the second fit has the smaller estimated error, 0 elsewhere; smoothed.
Planes Choice(const Halves& halves, const Planes& variance, const FittedHalves& first,
              const FittedHalves& second, TaskPool* pool) {
  const Planes mean = MeanOf(halves.a, halves.b, pool);
  const Planes mean_variance =
      ForEachValue(halves.width(), halves.height(), pool,
                   [&](size_t c, int x, int y) { return 0.5f * variance[c].At(x, y); });
  const auto smooth = [&](const Planes& map) {
    return NonLocalMeans(map, mean, mean_variance, kMapSmoothing, pool);
  };
  const Planes first_error = smooth(EstimatedError(halves, variance, first, pool));
  const Planes second_error = smooth(EstimatedError(halves, variance, second, pool));
  return smooth(ForEachValue(halves.width(), halves.height(), pool, [&](size_t c, int x, int y) {
    return first_error[c].At(x, y) < second_error[c].At(x, y) ? 0.0f : 1.0f;
  }));
}

Planes Mix(const Planes& first, const Planes& second, const Planes& choice, TaskPool* pool) {
  return ForEachValue(first[0].width(), first[0].height(), pool, [&](size_t c, int x, int y) {
    return first[c].At(x, y) + choice[c].At(x, y) * (second[c].At(x, y) - first[c].At(x, y));
  });
}

Picture FilterColor(const LayeredImage& film, absl::Span<const float> values, TaskPool* pool) {
  const Halves halves = NoisyHalves(film, pool);
  const Planes features = Features(film, pool);
  const Planes variance = HalfVariance(halves, pool);
  const FittedHalves first = FitHalves(halves, variance, features, values[0], pool);
  const FittedHalves second = FitHalves(halves, variance, features, values[1], pool);
  const Planes choice = Choice(halves, variance, first, second, pool);
  const FittedHalves chosen = {Mix(first.a, second.a, choice, pool), Mix(first.b, second.b, choice, pool)};
  const Planes mean = MeanOf(chosen.a, chosen.b, pool);
  const Planes residual = ForEachValue(halves.width(), halves.height(), pool, [&](size_t c, int x, int y) {
    return 0.5f * Square(chosen.a[c].At(x, y) - chosen.b[c].At(x, y));
  });
  return FinitePicture(PatchRegression({mean, mean, residual, features, values[2]}, pool), halves.scale);
}

}  // namespace

Baseline NforBaseline() {
  return {.info = {.name = "nfor",
                   .summary = "first-order regression on the features, weighted by non-local means",
                   .source = "Bitterli et al. 2016",
                   .parameters = {{"k_low", "strength of the first fit", 0.5f, {0.5f}, 0.01f, 100},
                                  {"k_high", "strength of the second fit", 1, {1, 2}, 0.01f, 100},
                                  {"k_final", "strength of the pass over the result", 1, {1}, 0.01f, 100}}},
          .filter = FilterColor};
}

}  // namespace lumifold::filter
