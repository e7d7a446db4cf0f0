#include "filter/baselines/nfor.h"

#include "filter/baselines/nfor_features.h"
#include "filter/baselines/noisy_halves.h"
#include "filter/baselines/non_local_means.h"
#include "filter/baselines/patch_regression.h"
#include "filter/image/planes.h"

namespace lumifold::filter {
namespace {

/// The filter of the maps of errors and choices.
constexpr NonLocalMeansParams kMapSmoothing = {.search_radius = 9, .patch_radius = 1, .strength = 1};

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

/// As the colours of the other half give the weights, so do its features explain the colours.
FittedHalves FitHalves(const Halves& halves, const Planes& variance, const CrossFeatures& features,
                       float strength, TaskPool* pool) {
  return {PatchRegression({halves.a, halves.b, variance, features.b, strength}, pool),
          PatchRegression({halves.b, halves.a, variance, features.a, strength}, pool)};
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

Picture FilterColor(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const Halves halves = NoisyHalves(film.pixels, pool);
  const CrossFeatures features = PrefilteredFeatures(film, pool);
  const Planes variance = HalfVariance(halves, pool);
  const FittedHalves first = FitHalves(halves, variance, features, values[0], pool);
  const FittedHalves second = FitHalves(halves, variance, features, values[1], pool);
  const Planes choice = Choice(halves, variance, first, second, pool);
  const FittedHalves chosen = {Mix(first.a, second.a, choice, pool), Mix(first.b, second.b, choice, pool)};
  const Planes mean = MeanOf(chosen.a, chosen.b, pool);
  const Planes residual = ForEachValue(halves.width(), halves.height(), pool, [&](size_t c, int x, int y) {
    return 0.5f * Square(chosen.a[c].At(x, y) - chosen.b[c].At(x, y));
  });
  return FinitePicture(PatchRegression({mean, mean, residual, features.mean, values[2]}, pool), halves.scale);
}

}  // namespace

Baseline NforBaseline() {
  return {
      .info = {.name = "nfor",
               .summary = "first-order regression on the features, weighted by non-local means",
               .source = "Bitterli et al. 2016; features prefiltered on edges, variance from the halves",
               .parameters = {{"k_low", "strength of the first fit", 0.5f, {0.5f, 1}, 0.01f, 100},
                              {"k_high", "strength of the second fit", 1, {2, 4, 1}, 0.01f, 100},
                              {"k_final", "strength of the pass over the result", 1, {2, 1}, 0.01f, 100}}},
      .filter = FilterColor};
}

}  // namespace lumifold::filter
