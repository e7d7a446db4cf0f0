#include "filter/metrics/error_estimate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string_view>

#include "filter/image/filtered_picture.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::metrics {
namespace {

constexpr int kWidth = 100;
constexpr int kHeight = 60;
constexpr float kLight = 0.5f;
constexpr float kEstimatedSigma = 0.1f;  // of one sample
constexpr int kBlock = 8;

/// A film of `samples` per pixel whose samples are normally distributed around kLight.
LayeredImage NoiseFilm(int samples, std::mt19937* random) {
  LayeredImage film(kWidth, kHeight);
  const float half = static_cast<float>(samples) / 2;
  std::normal_distribution<float> noise(kLight, kEstimatedSigma / std::sqrt(half));
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

/// What the "filter" makes of a film, with the deviation that its halves show.
FilteredPicture FilterHalves(const LayeredImage& film, float noise, float bias) {
  FilteredPicture filtered = {Filter(film, noise, bias), {}, {}};
  const ConstColorView a = film.GetColor(layers::HalfA(layers::kNoisy));
  const ConstColorView b = film.GetColor(layers::HalfB(layers::kNoisy));
  for (size_t c = 0; c < 3; ++c) {
    filtered.deviation[c] = Plane(kWidth, kHeight);
    ForEachPixel(kWidth, kHeight, [&](int x, int y) {
      filtered.deviation[c].At(x, y) = 0.5f * noise * (a[c].At(x, y) - b[c].At(x, y));
    });
  }
  return filtered;
}

LayeredImage MakeFilm(int samples) {
  std::mt19937 random(3);
  return NoiseFilm(samples, &random);
}

ErrorEstimate EstimateOf(const LayeredImage& film, const FilteredPicture& filtered,
                         ErrorMetric metric = ErrorMetric::kRelMse, TaskPool* pool = nullptr) {
  return EstimateError({film, filtered}, kBlock, metric, pool);
}

double MeanOf(const ErrorEstimate& estimate) {
  double sum = 0;
  for (const double block : estimate.blocks) sum += block;
  return sum / static_cast<double>(estimate.blocks.size());
}

/// Variance of the picture in units of RelMse.
double TrueVariance(int samples, float noise) {
  const double variance = static_cast<double>(noise * noise * kEstimatedSigma * kEstimatedSigma) / samples;
  return variance / (static_cast<double>(kLight) * static_cast<double>(kLight) + 0.01);
}

/// What the estimate has over the variance where the filter leaves this part of the noise.
double OverVariance(double noise) { return 1 + (kErrorOverVariance - 1) * (1 - noise * noise); }

TEST(EstimateError, FindsTheVarianceOfWhatTheFilterLeaves) {
  for (const int samples : {16, 64}) {
    const LayeredImage film = MakeFilm(samples);
    const ErrorEstimate estimate = EstimateOf(film, FilterHalves(film, 0.3f, 0));
    EXPECT_NEAR(MeanOf(estimate) / (OverVariance(0.3) * TrueVariance(samples, 0.3f)), 1, 0.05) << samples;
    EXPECT_EQ(estimate.columns, 13);
    EXPECT_EQ(estimate.rows, 8);
  }
}

TEST(EstimateError, AddsNothingToTheVarianceOfAPictureThatIsNotFiltered) {
  const LayeredImage film = MakeFilm(16);
  const ErrorEstimate estimate = EstimateOf(film, FilterHalves(film, 1, 0));
  EXPECT_NEAR(MeanOf(estimate) / TrueVariance(16, 1), 1, 0.05);
}

TEST(EstimateError, AddsNothingToThatOfHalvesOfUnequalCounts) {
  LayeredImage film = MakeFilm(16);
  const double of_equal = MeanOf(EstimateOf(film, FilterHalves(film, 1, 0)));
  constexpr float kShareOfA = 0.75f;
  FilteredPicture filtered = FilterHalves(film, 1, 0);
  const ColorView a = film.GetColor(layers::HalfA(layers::kNoisy));
  const ColorView b = film.GetColor(layers::HalfB(layers::kNoisy));
  const float deviations = std::sqrt(kShareOfA * (1 - kShareOfA));
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    film.Get(layers::kSamplesA).At(x, y) = 16 * kShareOfA;
    film.Get(layers::kSamplesB).At(x, y) = 16 * (1 - kShareOfA);
    for (size_t c = 0; c < 3; ++c) {
      filtered.picture[c].At(x, y) = kShareOfA * a[c].At(x, y) + (1 - kShareOfA) * b[c].At(x, y);
      filtered.deviation[c].At(x, y) = deviations * (a[c].At(x, y) - b[c].At(x, y));
    }
  });
  const double expected = static_cast<double>(4 * deviations * deviations);
  EXPECT_NEAR(MeanOf(EstimateOf(film, filtered)) / of_equal, expected, 0.02);
}

TEST(EstimateError, CountsReturnedEnergyButNotWhereItReturns) {
  const LayeredImage film = MakeFilm(32);
  FilteredPicture filtered = FilterHalves(film, 0.3f, 0);
  const ErrorEstimate before = EstimateOf(film, filtered);
  // Energy returns to the left half alone.
  for (Plane& plane : filtered.returned) {
    plane = Plane(kWidth, kHeight);
    ForEachPixel(kWidth / 2, kHeight, [&](int x, int y) { plane.At(x, y) = 0.01f; });
  }
  const ErrorEstimate after = EstimateOf(film, filtered);
  const double light = static_cast<double>(kLight);
  const double returned = 0.5 * OverVariance(0.3) * 0.01 * 0.01 / (light * light + 0.01);
  EXPECT_NEAR((MeanOf(after) - MeanOf(before)) / returned, 1, 0.1);
  EXPECT_NEAR(after.blocks[0] / after.blocks[12], before.blocks[0] / before.blocks[12], 1e-5);
}

/// Replaces columns [first, last) by those of a filter that leaves more noise, with a pattern on top.
void Roughen(const LayeredImage& film, int first, int last, float noise, float pattern,
             FilteredPicture* filtered) {
  const FilteredPicture rough = FilterHalves(film, noise, 0);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = first; x < last; ++x) {
        filtered->picture[c].At(x, y) =
            rough.picture[c].At(x, y) + ((x / 2 + y / 2) % 2 == 0 ? pattern : -pattern);
        filtered->deviation[c].At(x, y) = rough.deviation[c].At(x, y);
      }
    }
  }
}

/// Makes the deviation of the first block a tenth of what it is.
void MakeFirstBlockLucky(FilteredPicture* filtered) {
  for (Plane& plane : filtered->deviation)
    ForEachPixel(kBlock, kBlock, [&](int x, int y) { plane.At(x, y) *= 0.1f; });
}

TEST(EstimateError, DoesNotTrustABlockThatHadLuck) {
  const LayeredImage film = MakeFilm(32);
  FilteredPicture filtered = FilterHalves(film, 0.3f, 0);
  MakeFirstBlockLucky(&filtered);
  const ErrorEstimate estimate = EstimateOf(film, filtered);
  EXPECT_GT(estimate.blocks[0], 0.5 * MeanOf(estimate)) << "of itself it would have a hundredth";
  EXPECT_NEAR(MeanOf(estimate) / (OverVariance(0.3) * TrueVariance(32, 0.3f)), 1, 0.05) << "the mean stays";
}

TEST(EstimateError, DoesNotTrustABlockThatHasMetNothing) {
  LayeredImage film = MakeFilm(32);
  const FilteredPicture filtered = FilterHalves(film, 0.3f, 0);
  // All samples of two blocks are alike; the filter changed the first of them.
  for (const int block : {0, 8}) {
    for (const std::string& name : {layers::HalfA(layers::kNoisy), layers::HalfB(layers::kNoisy)}) {
      for (size_t c = 0; c < 3; ++c) {
        ForEachPixel(kBlock, kBlock, [&](int x, int y) {
          const float value = filtered.picture[c].At(block * kBlock + x, y);
          film.GetColor(name)[c].At(block * kBlock + x, y) = block == 0 ? 0.0f : value;
        });
      }
    }
  }
  FilteredPicture seen = FilterHalves(film, 0.3f, 0);
  for (size_t c = 0; c < 3; ++c) CopyPlane(filtered.picture[c].view(), seen.picture[c].view());
  const ErrorEstimate estimate = EstimateOf(film, seen);
  EXPECT_GT(estimate.blocks[0], 0.3 * MeanOf(estimate));
  EXPECT_EQ(estimate.blocks[8], 0);
}

TEST(EstimateError, LeavesBlocksAloneThatAreShownAsWhite) {
  const LayeredImage film = MakeFilm(32);
  FilteredPicture filtered = FilterHalves(film, 0.3f, 0);
  for (size_t c = 0; c < 3; ++c)
    ForEachPixel(kBlock, kBlock, [&](int x, int y) { filtered.picture[c].At(x, y) = 2; });
  EXPECT_EQ(EstimateOf(film, filtered, ErrorMetric::kMse255).blocks[0], 0);
}

TEST(EstimateError, LeavesBlocksApartThatTheFilterTreatsUnlike) {
  const LayeredImage film = MakeFilm(32);
  FilteredPicture filtered = FilterHalves(film, 0.03f, 0);
  Roughen(film, kWidth / 2, kWidth, 0.3f, 0, &filtered);
  const ErrorEstimate estimate = EstimateOf(film, filtered);
  EXPECT_GT(estimate.blocks[12] / estimate.blocks[0], 50) << "100, of which little is lost";
}

TEST(EstimateError, DrawsABlockTowardsThoseOfItsDetail) {
  // The left half has a pattern, and the filter leaves ten times as much noise there; one of its blocks had
  // luck.
  const LayeredImage film = MakeFilm(32);
  FilteredPicture filtered = FilterHalves(film, 0.03f, 0);
  Roughen(film, 0, kWidth / 2, 0.3f, 1, &filtered);
  MakeFirstBlockLucky(&filtered);
  const ErrorEstimate estimate = EstimateOf(film, filtered);
  EXPECT_GT(estimate.blocks[0], 0.4 * estimate.blocks[1]) << "of itself it would have a hundredth";
  EXPECT_GT(estimate.blocks[0] / estimate.blocks[12], 20) << "noise alone would draw it towards these";
}

TEST(EstimateError, DrawsABlockTowardsThoseOfItsEdges) {
  // The left half's blocks have an edge pixel each, and the filter leaves ten times as much noise there. All
  // have the same pattern.
  const LayeredImage film = MakeFilm(32);
  FilteredPicture filtered = FilterHalves(film, 0.03f, 0);
  Roughen(film, 0, kWidth, 0.03f, 1, &filtered);
  Roughen(film, 0, kWidth / 2, 0.3f, 1, &filtered);
  MakeFirstBlockLucky(&filtered);
  constexpr int kEdgeColumns = 6;
  LayeredImage edges(/*width=*/1, kEdgeColumns * kHeight / kBlock);
  for (const std::string_view name : {layers::kPixelX, layers::kPixelY}) edges.Add(name);
  for (int row = 0; row < edges.height(); ++row) {
    const int x = row % kEdgeColumns * kBlock;
    const int y = row / kEdgeColumns * kBlock;
    edges.Get(layers::kPixelX).At(0, row) = static_cast<float>(x);
    edges.Get(layers::kPixelY).At(0, row) = static_cast<float>(y);
  }
  const auto first_over_other = [&](const LayeredImage* edge_set) {
    const FilteredFilm view = {film, filtered, edge_set};
    const ErrorEstimate estimate = EstimateError(view, kBlock, ErrorMetric::kRelMse, nullptr);
    return estimate.blocks[0] / estimate.blocks[12];
  };
  EXPECT_GT(first_over_other(&edges), 1.5 * first_over_other(nullptr));
}

TEST(EstimateError, MarksBlocksWithoutTwoHalves) {
  LayeredImage film = MakeFilm(32);
  const FilteredPicture filtered = FilterHalves(film, 0.3f, 0);
  ForEachPixel(kBlock, kBlock, [&](int x, int y) { film.Get(layers::kSamplesB).At(x, y) = 0; });
  const ErrorEstimate estimate = EstimateOf(film, filtered);
  EXPECT_LT(estimate.blocks[0], 0);
  EXPECT_GT(estimate.blocks[1], 0);
}

TEST(EstimateError, CountsSteepDarkTonesMoreInMse255) {
  const LayeredImage film = MakeFilm(32);
  const ErrorEstimate estimate = EstimateOf(film, FilterHalves(film, 0.3f, 0), ErrorMetric::kMse255);
  const double slope = 255 * 1.055 / 2.4 * std::pow(static_cast<double>(kLight), 1 / 2.4 - 1);
  const double variance = static_cast<double>(0.3f * 0.3f * kEstimatedSigma * kEstimatedSigma) / 32;
  EXPECT_NEAR(MeanOf(estimate) / (OverVariance(0.3) * slope * slope * variance), 1, 0.05);
}

TEST(EstimateError, KnowsTheEndsOfTheDisplaysCurve) {
  const LayeredImage film = MakeFilm(32);
  FilteredPicture filtered = FilterHalves(film, 0.3f, 0);
  const double before = MeanOf(EstimateOf(film, filtered, ErrorMetric::kMse255));
  for (Plane& plane : filtered.deviation) plane.At(50, 30) = 1000;  // one unlucky pixel
  const double after = MeanOf(EstimateOf(film, filtered, ErrorMetric::kMse255));
  EXPECT_GT(after, before);
  // It counts for less than black in place of white; by the slope of the curve it would count for millions.
  EXPECT_LT((after - before) * kWidth * kHeight, 1.1 * 255 * 255);
  for (size_t c = 0; c < 3; ++c) {
    filtered.picture[c].At(50, 30) = 1.1f;  // shown as white, and so is all above
    filtered.deviation[c].At(50, 30) = 0.01f;
  }
  EXPECT_LT(MeanOf(EstimateOf(film, filtered, ErrorMetric::kMse255)), before);
}

TEST(EstimateError, IsTheSameForAnyPool) {
  const LayeredImage film = MakeFilm(32);
  const FilteredPicture filtered = FilterHalves(film, 0.3f, 0);
  ShufflingPool pool(7);
  EXPECT_EQ(EstimateOf(film, filtered).blocks,
            EstimateOf(film, filtered, ErrorMetric::kRelMse, &pool).blocks);
}

}  // namespace
}  // namespace lumifold::metrics
