#include "filter/layers/choice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/support/shuffling_pool.h"

namespace lumifold::filter {
namespace {

constexpr int kChoiceWidth = 96;
constexpr int kChoiceHeight = 80;
constexpr float kChoiceNoise = 0.4f;  // deviation of a half of N
constexpr float kChoiceSamples = 16;  // of both halves
constexpr ChoiceParams kParams;

float Truth(int x, int y) { return 1.0f + 0.3f * static_cast<float>((x / 8 + y / 8) % 2); }

/// The truth and noise of deviation `noise`, independent in both halves.
Candidate Noisy(float noise, uint32_t seed) {
  Candidate picture = {MakePlanes(3, kChoiceWidth, kChoiceHeight),
                       MakePlanes(3, kChoiceWidth, kChoiceHeight)};
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  for (Planes* half : {&picture.a, &picture.b}) {
    for (Plane& plane : *half)
      ForEachPixel(kChoiceWidth, kChoiceHeight,
                   [&](int x, int y) { plane.At(x, y) = Truth(x, y) + noise * normal(random); });
  }
  return picture;
}

/// body(&value, truth) for all values of both halves.
template <typename Body>
Candidate Changed(const Candidate& from, const Body& body) {
  Candidate changed = {Clone(from.a), Clone(from.b)};
  for (Planes* half : {&changed.a, &changed.b}) {
    for (Plane& plane : *half) {
      ForEachPixel(kChoiceWidth, kChoiceHeight,
                   [&](int x, int y) { plane.At(x, y) = body(x, y, plane.At(x, y), Truth(x, y)); });
    }
  }
  return changed;
}

Halves HalvesOf(const Candidate& noisy) {
  Halves halves;
  halves.a = Clone(noisy.a);
  halves.b = Clone(noisy.b);
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight})
    *plane = MakePlane(kChoiceWidth, kChoiceHeight, 1.0f);
  halves.share_a = MakePlane(kChoiceWidth, kChoiceHeight, 0.5f);
  halves.samples = MakePlane(kChoiceWidth, kChoiceHeight, kChoiceSamples);
  halves.level = 1;
  halves.has_noise_estimate = true;
  return halves;
}

Plane ShareOf(const Halves& halves, const Candidate& f, const Candidate& g, TaskPool* pool = nullptr) {
  return Choice(halves, MakePlane(kChoiceWidth, kChoiceHeight, 1.0f), kParams, nullptr, pool)
      .ShareOf(f, g, pool);
}

double MeanOf(const Plane& plane) {
  double sum = 0;
  ForEachPixel(kChoiceWidth, kChoiceHeight,
               [&](int x, int y) { sum += static_cast<double>(plane.At(x, y)); });
  return sum / (kChoiceWidth * kChoiceHeight);
}

/// Mean square error of the mean of both halves.
double ErrorOf(const Candidate& picture) {
  double sum = 0;
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(kChoiceWidth, kChoiceHeight, [&](int x, int y) {
      const float mean = 0.5f * (picture.a[c].At(x, y) + picture.b[c].At(x, y));
      const auto off = static_cast<double>(mean - Truth(x, y));
      sum += off * off;
    });
  }
  return sum / (3 * kChoiceWidth * kChoiceHeight);
}

void MoveBoth(const Candidate& towards, const Plane& share, Candidate* picture) {
  MoveTowards(towards.a, share, nullptr, &picture->a);
  MoveTowards(towards.b, share, nullptr, &picture->b);
}

TEST(Choice, FindsTheShareOfLeastError) {
  constexpr float kBias = 0.2f;
  constexpr float kKept = 0.5f;  // of the noise
  const Candidate noisy = Noisy(kChoiceNoise, 1);
  const Halves halves = HalvesOf(noisy);
  Candidate f = Changed(noisy, [](int, int, float, float truth) { return truth + kBias; });
  const Candidate g =
      Changed(noisy, [](int, int, float value, float truth) { return truth + kKept * (value - truth); });
  constexpr float kVariance = kKept * kKept * kChoiceNoise * kChoiceNoise / 2;
  constexpr float kOptimum = kBias * kBias / (kBias * kBias + kVariance);
  const Plane share = ShareOf(halves, f, g);
  EXPECT_NEAR(MeanOf(share), static_cast<double>(kOptimum), 0.05);
  MoveBoth(g, share, &f);
  EXPECT_LT(ErrorOf(f), 1.05 * static_cast<double>(kBias * kBias * (1 - kOptimum)));
}

TEST(Choice, GivesNoiseNoShare) {
  double share_of_noise = 0;
  double added = 0;
  double error_of_noisy = 0;
  constexpr uint32_t kSeeds = 12;
  for (uint32_t seed = 1; seed <= kSeeds; ++seed) {
    const Candidate noisy = Noisy(kChoiceNoise, seed);
    const Halves halves = HalvesOf(noisy);
    Candidate truth = Noisy(0, 1);
    share_of_noise += MeanOf(ShareOf(halves, truth, Noisy(0.3f, 100 + seed))) / kSeeds;
    MoveBoth(noisy, ShareOf(halves, truth, noisy), &truth);
    added += ErrorOf(truth) / kSeeds;
    error_of_noisy += ErrorOf(noisy) / kSeeds;
  }
  EXPECT_LT(share_of_noise, 0.03);
  EXPECT_LT(added, 0.02 * error_of_noisy);
}

/// Share of the noisy picture at a pixel that both halves show `factor` times as bright as its neighbours.
float ShareOfLonePixel(float factor, float samples, float expected_difference = 0) {
  constexpr int kX = 40, kY = 33;
  const float noise = 1.0f / std::sqrt(samples / 2);
  Candidate noisy = Noisy(noise, 7);
  for (Planes* half : {&noisy.a, &noisy.b}) {
    for (Plane& plane : *half) plane.At(kX, kY) *= factor;
  }
  Halves halves = HalvesOf(noisy);
  halves.samples.Fill(samples);
  halves.expected_difference = MakePlane(kChoiceWidth, kChoiceHeight, expected_difference);
  return ShareOf(halves, Noisy(0, 1), noisy).At(kX, kY);
}

TEST(Choice, ManySamplesTellOfOnePixelAloneAndFewDoNot) {
  EXPECT_LT(ShareOfLonePixel(500, 16), 0.1f);
  EXPECT_GT(ShareOfLonePixel(500, 4096), 0.5f);
}

TEST(Choice, OnePixelIsNotBelievedWhereItsHalvesAgreeByChance) {
  EXPECT_LT(ShareOfLonePixel(500, 4096, 3 * 500 * 500), 0.1f);
}

TEST(Choice, NoiseThatPicturesHaveInCommonCancels) {
  const Candidate noisy = Noisy(kChoiceNoise, 3);
  const Candidate g =
      Changed(noisy, [](int, int, float value, float truth) { return truth + 0.7f * (value - truth); });
  const Candidate f = Changed(g, [](int, int, float value, float) { return value + 0.1f; });
  EXPECT_GT(MeanOf(ShareOf(HalvesOf(noisy), f, g)), 0.95);
  EXPECT_LT(MeanOf(ShareOf(HalvesOf(noisy), g, f)), 0.05);
}

TEST(Choice, ComparesMixedPixelsApart) {
  const auto is_mixed = [](int x) { return x % 4 == 0; };
  const Candidate noisy = Noisy(kChoiceNoise, 4);
  Halves halves = HalvesOf(noisy);
  halves.is_mixed = Plane(kChoiceWidth, kChoiceHeight);
  ForEachPixel(kChoiceWidth, kChoiceHeight,
               [&](int x, int y) { halves.is_mixed.At(x, y) = is_mixed(x) ? 1.0f : 0.0f; });
  const Candidate f =
      Changed(noisy, [&](int x, int, float, float truth) { return is_mixed(x) ? truth + 1 : truth; });
  const Candidate g =
      Changed(noisy, [&](int x, int, float, float truth) { return is_mixed(x) ? truth : truth + 0.2f; });
  const Plane share = ShareOf(halves, f, g);
  double mixed = 0;
  double others = 0;
  ForEachPixel(kChoiceWidth, kChoiceHeight,
               [&](int x, int y) { (is_mixed(x) ? mixed : others) += static_cast<double>(share.At(x, y)); });
  EXPECT_GT(4 * mixed / (kChoiceWidth * kChoiceHeight), 0.95);
  EXPECT_LT(4 * others / (3 * kChoiceWidth * kChoiceHeight), 0.1);
}

TEST(Choice, ComparesPixelsOfSeveralSurfacesByTheirSurfaces) {
  // In each fourth column two surfaces of light 0 and 2 cover a half of each pixel. F blurs them into each
  // other, which leaves their mean as it is; G does not. At all other pixels F is the truth, and G is not.
  const auto has_points = [](int x) { return x % 4 == 0; };
  const Candidate noisy = Noisy(kChoiceNoise, 7);
  Candidate f = Changed(noisy, [](int, int, float, float truth) { return truth; });
  Candidate g =
      Changed(noisy, [&](int x, int, float, float truth) { return has_points(x) ? truth : truth + 0.2f; });
  ChoicePoints points;
  std::mt19937 random(5);
  std::normal_distribution<float> noise(0, kChoiceNoise);
  ForEachPixel(kChoiceWidth, kChoiceHeight, [&](int x, int y) {
    if (!has_points(x)) return;
    for (const float truth : {0.0f, 2.0f}) {
      points.places.push_back({x, y});
      points.weights.push_back(0.25f);
      points.samples.push_back(kChoiceSamples / 2);
      for (size_t h = 0; h < 2; ++h) {
        for (size_t c = 0; c < 3; ++c) {
          points.noisy[h].push_back(truth + noise(random));
          f.points[h].push_back(1);
          g.points[h].push_back(truth);
        }
      }
    }
  });
  const Halves halves = HalvesOf(noisy);
  const Choice choice(halves, MakePlane(kChoiceWidth, kChoiceHeight, 1.0f), kParams, &points, nullptr);
  const Plane share = choice.ShareOf(f, g, nullptr);
  ForEachPixel(kChoiceWidth, kChoiceHeight, [&](int x, int y) {
    EXPECT_NEAR(share.At(x, y), has_points(x) ? 1.0f : 0.0f, 0.15f) << x << ", " << y;
  });
  // Points that a half lacks say nothing.
  std::fill(points.weights.begin(), points.weights.end(), 0.0f);
  const Plane unknown =
      Choice(halves, MakePlane(kChoiceWidth, kChoiceHeight, 1.0f), kParams, &points, nullptr)
          .ShareOf(f, g, nullptr);
  EXPECT_EQ(unknown.At(4, 9), 0);
}

TEST(Choice, KnowsNothingOfPixelsWithOneHalf) {
  const Candidate noisy = Noisy(kChoiceNoise, 5);
  Halves halves = HalvesOf(noisy);
  halves.weight_b.Fill(0);
  const Candidate f = Changed(noisy, [](int, int, float, float truth) { return truth + 5; });
  EXPECT_EQ(MeanOf(ShareOf(halves, f, Noisy(0, 1))), 0);
}

TEST(Choice, GivesTheSameBitsForAnyPool) {
  const Candidate noisy = Noisy(kChoiceNoise, 6);
  const Halves halves = HalvesOf(noisy);
  const Candidate f =
      Changed(noisy, [](int x, int, float, float truth) { return truth + (x < 40 ? 0.3f : 0.f); });
  ShufflingPool pool(11);
  const Plane alone = ShareOf(halves, f, noisy);
  const Plane shuffled = ShareOf(halves, f, noisy, &pool);
  for (int y = 0; y < kChoiceHeight; ++y)
    EXPECT_TRUE(std::equal(alone.Row(y), alone.Row(y) + kChoiceWidth, shuffled.Row(y))) << y;
}

}  // namespace
}  // namespace lumifold::filter
