#include "filter/metrics/error_estimate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string_view>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::metrics {
namespace {

constexpr int kWidth = 100;
constexpr int kHeight = 60;
constexpr float kLight = 0.5f;
constexpr float kSigma = 0.1f;  // of one sample
constexpr int kBlock = 8;

/// A film of `samples` per pixel whose samples are normally distributed around kLight.
LayeredImage NoiseFilm(int samples, std::mt19937* random) {
  LayeredImage film(kWidth, kHeight);
  const float half = static_cast<float>(samples) / 2;
  std::normal_distribution<float> noise(kLight, kSigma / std::sqrt(half));
  ColorView mean = film.AddColor(layers::kNoisy);
  ColorView a = film.AddColor(layers::HalfA(layers::kNoisy));
  ColorView b = film.AddColor(layers::HalfB(layers::kNoisy));
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB}) film.Add(name);
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB}) {
    ForEachPixel(kWidth, kHeight, [&](int x, int y) { film.Get(name).At(x, y) = half; });
  }
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(kWidth, kHeight, [&](int x, int y) {
      a[c].At(x, y) = noise(*random);
      b[c].At(x, y) = noise(*random);
      mean[c].At(x, y) = 0.5f * (a[c].At(x, y) + b[c].At(x, y));
    });
  }
  return film;
}

/// The film of the samples of both.
LayeredImage Joined(const LayeredImage& first, const LayeredImage& second) {
  LayeredImage both = first.Crop(first.bounds());
  const float m = first.Get(layers::kSamplesA).At(0, 0);
  const float n = m + second.Get(layers::kSamplesA).At(0, 0);
  for (LayeredImage::Channel& channel : both.channels()) {
    const bool is_count = channel.name == layers::kSamplesA || channel.name == layers::kSamplesB;
    const ConstFloatView more = second.Get(channel.name);
    ForEachPixel(kWidth, kHeight, [&](int x, int y) {
      float& value = channel.plane.At(x, y);
      value = is_count ? n : (value * m + more.At(x, y) * (n - m)) / n;
    });
  }
  return both;
}

/// A "filter" that scales the difference from kLight: what is left of noise, and a bias.
Picture Filter(const LayeredImage& film, float noise, float bias) {
  Picture picture;
  const ConstColorView mean = film.GetColor(layers::kNoisy);
  for (size_t c = 0; c < 3; ++c) {
    picture[c] = Plane(kWidth, kHeight);
    ForEachPixel(kWidth, kHeight, [&](int x, int y) {
      picture[c].At(x, y) = kLight + bias + noise * (mean[c].At(x, y) - kLight);
    });
  }
  return picture;
}

struct Case {
  LayeredImage earlier;
  LayeredImage later;
};

Case MakeCase(int earlier_samples, int later_samples) {
  std::mt19937 random(3);
  LayeredImage first = NoiseFilm(earlier_samples, &random);
  LayeredImage more = NoiseFilm(later_samples - earlier_samples, &random);
  LayeredImage both = Joined(first, more);
  return {std::move(first), std::move(both)};
}

double MeanOf(const ErrorEstimate& estimate) {
  double sum = 0;
  for (const double block : estimate.blocks) sum += block;
  return sum / static_cast<double>(estimate.blocks.size());
}

ErrorEstimate EstimateOf(const Case& films, float noise, float bias, TaskPool* pool = nullptr) {
  const Picture earlier = Filter(films.earlier, noise, bias);
  const Picture later = Filter(films.later, noise, bias);
  return EstimateError({films.earlier, ViewOf(earlier)}, {films.later, ViewOf(later)}, kBlock,
                       ErrorMetric::kRelMse, pool);
}

/// Squared error of the later picture in units of RelMse.
double TrueError(int samples, float noise, float bias) {
  const double variance = static_cast<double>(noise * noise * kSigma * kSigma) / samples;
  const double value = static_cast<double>(kLight + bias);
  return (variance + static_cast<double>(bias * bias)) / (value * value + 0.01);
}

/// The estimate over the variance of a filter whose error is noise alone, which falls as 1 / samples: it allows for bias.
double Allowance(double growth) {
  return (growth - 1) / (std::pow(growth, static_cast<double>(kErrorDecline)) - 1);
}

TEST(EstimateError, FindsTheVarianceOfWhatTheFilterLeaves) {
  for (const int later : {24, 32, 64}) {
    const ErrorEstimate estimate = EstimateOf(MakeCase(16, later), 0.3f, 0);
    EXPECT_NEAR(MeanOf(estimate) / estimate.bias_factor / TrueError(later, 0.3f, 0), Allowance(later / 16.0),
                0.1)
        << later;
    EXPECT_EQ(estimate.columns, 13);
    EXPECT_EQ(estimate.rows, 8);
  }
}

TEST(EstimateError, FindsBiasByTheNewSamples) {
  // Bias twice as large as the noise that is left makes the error of the earlier picture five times as large.
  const float bias = 2 * 0.3f * kSigma / 4;
  const ErrorEstimate estimate = EstimateOf(MakeCase(16, 32), 0.3f, bias);
  EXPECT_NEAR(estimate.bias_factor, 5 / (Allowance(2) * std::pow(2, double{kErrorDecline}) / 2), 0.5);
}

TEST(EstimateError, TakesNoNoiseForBias) {
  EXPECT_NEAR(EstimateOf(MakeCase(16, 32), 0.3f, 0).bias_factor, kUsualBiasFactor, 0.1);
}

TEST(EstimateError, DoesNotTrustABlockThatHadLuck) {
  const Case films = MakeCase(16, 32);
  Picture earlier = Filter(films.earlier, 0.3f, 0);
  const Picture later = Filter(films.later, 0.3f, 0);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(kBlock, kBlock, [&](int x, int y) {
      const float value = later[c].At(x, y);
      earlier[c].At(x, y) = value + 0.1f * (earlier[c].At(x, y) - value);
    });
  }
  const ErrorEstimate estimate = EstimateError({films.earlier, ViewOf(earlier)}, {films.later, ViewOf(later)},
                                               kBlock, ErrorMetric::kRelMse, nullptr);
  EXPECT_GT(estimate.blocks[0], 0.5 * MeanOf(estimate)) << "of itself it would have a hundredth";
  EXPECT_NEAR(MeanOf(estimate) / estimate.bias_factor / TrueError(32, 0.3f, 0), Allowance(2), 0.1)
      << "the mean stays";
}

TEST(EstimateError, LeavesBlocksApartThatTheFilterTreatsUnlike) {
  const Case films = MakeCase(16, 32);
  Picture earlier = Filter(films.earlier, 0.3f, 0);
  Picture later = Filter(films.later, 0.3f, 0);
  const Picture clean_earlier = Filter(films.earlier, 0.03f, 0);
  const Picture clean_later = Filter(films.later, 0.03f, 0);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(kWidth / 2, kHeight, [&](int x, int y) {
      earlier[c].At(x, y) = clean_earlier[c].At(x, y);
      later[c].At(x, y) = clean_later[c].At(x, y);
    });
  }
  const ErrorEstimate estimate = EstimateError({films.earlier, ViewOf(earlier)}, {films.later, ViewOf(later)},
                                               kBlock, ErrorMetric::kRelMse, nullptr);
  EXPECT_GT(estimate.blocks[12] / estimate.blocks[0], 50) << "100, of which little is lost";
}

TEST(EstimateError, DrawsABlockTowardsThoseOfItsDetail) {
  // The left half has a pattern, and the filter leaves ten times as much noise there; one of its blocks had luck.
  const Case films = MakeCase(16, 32);
  Picture earlier = Filter(films.earlier, 0.03f, 0);
  Picture later = Filter(films.later, 0.03f, 0);
  const Picture rough_earlier = Filter(films.earlier, 0.3f, 0);
  const Picture rough_later = Filter(films.later, 0.3f, 0);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(kWidth / 2, kHeight, [&](int x, int y) {
      const float pattern = (x / 2 + y / 2) % 2 == 0 ? 1.0f : -1.0f;
      const bool is_lucky = x < kBlock && y < kBlock;
      const float value = rough_later[c].At(x, y);
      later[c].At(x, y) = value + pattern;
      earlier[c].At(x, y) = value + pattern + (is_lucky ? 0.1f : 1.0f) * (rough_earlier[c].At(x, y) - value);
    });
  }
  const ErrorEstimate estimate = EstimateError({films.earlier, ViewOf(earlier)}, {films.later, ViewOf(later)},
                                               kBlock, ErrorMetric::kRelMse, nullptr);
  EXPECT_GT(estimate.blocks[0], 0.4 * estimate.blocks[1]) << "of itself it would have a hundredth";
  EXPECT_GT(estimate.blocks[0] / estimate.blocks[12], 20) << "noise alone would draw it towards these";
}

TEST(EstimateError, MarksBlocksWithoutNewSamples) {
  const Case films = MakeCase(16, 32);
  const ErrorEstimate estimate = EstimateError({films.later, films.later.GetColor(layers::kNoisy)},
                                               {films.later, films.later.GetColor(layers::kNoisy)}, kBlock,
                                               ErrorMetric::kRelMse, nullptr);
  for (const double block : estimate.blocks) EXPECT_LT(block, 0);
}

TEST(EstimateError, CountsSteepDarkTonesMoreInMse255) {
  const Case films = MakeCase(16, 32);
  const Picture earlier = Filter(films.earlier, 0.3f, 0);
  const Picture later = Filter(films.later, 0.3f, 0);
  const ErrorEstimate estimate = EstimateError({films.earlier, ViewOf(earlier)}, {films.later, ViewOf(later)},
                                               kBlock, ErrorMetric::kMse255, nullptr);
  const double slope = 255 * 1.055 / 2.4 * std::pow(static_cast<double>(kLight), 1 / 2.4 - 1);
  EXPECT_NEAR(MeanOf(estimate) / estimate.bias_factor / (slope * slope * 0.09 * 0.01 / 32), Allowance(2),
              0.1);
}

TEST(EstimateError, IsTheSameForAnyPool) {
  const Case films = MakeCase(16, 32);
  ShufflingPool pool(7);
  EXPECT_EQ(EstimateOf(films, 0.3f, 0).blocks, EstimateOf(films, 0.3f, 0, &pool).blocks);
}

}  // namespace
}  // namespace lumifold::metrics
