// Adaptive sampling where it may fail: renderer, filter, estimate and policy together, on small pictures.
#include "tests/charts/films/adaptive_film.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/tile_samples.h"
#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"
#include "tests/support/analytic_scenes.h"
#include "tests/support/rare_light.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::charts {
namespace {

using lumifold::testing::CausticRoom;
using lumifold::testing::KeyholeRoom;
using lumifold::testing::Lambert;
using scene::Scene;

constexpr int kFilmWidth = 64;
constexpr int kFilmHeight = 48;
constexpr int kColumns = kFilmWidth / kSampleBlock;
constexpr int kUniformSamples = 96;  // of the first three rounds

using Sky = std::shared_ptr<const render::Environment>;

AdaptiveFilm Render(const Scene& scene, double budget, double target_error = 0, Sky sky = nullptr,
                    uint64_t seed = 0) {
  render::RenderSettings settings;
  settings.width = kFilmWidth;
  settings.height = kFilmHeight;
  settings.environment = std::move(sky);
  settings.seed = seed;
  const auto renderer = render::Renderer::Create(std::make_shared<const Scene>(scene), settings).value();
  return RenderAdaptively(
      *renderer, {.width = kFilmWidth, .height = kFilmHeight, .budget = budget, .target_error = target_error},
      metrics::ErrorMetric::kMse255, nullptr);
}

/// Row by row.
std::vector<double> SamplesByBlock(const AdaptiveFilm& film) {
  const ConstFloatView a = film.film.pixels.Get(layers::kSamplesA);
  const ConstFloatView b = film.film.pixels.Get(layers::kSamplesB);
  std::vector<double> samples;
  for (int y = 0; y < kFilmHeight; y += kSampleBlock) {
    for (int x = 0; x < kFilmWidth; x += kSampleBlock)
      samples.push_back(static_cast<double>(a.At(x, y) + b.At(x, y)));
  }
  return samples;
}

/// Mean samples of the blocks of a rectangle of pixels.
double MeanIn(const std::vector<double>& samples, const Rect& pixels) {
  double sum = 0;
  int blocks = 0;
  for (int y = pixels.y0; y < pixels.y1; y += kSampleBlock) {
    for (int x = pixels.x0; x < pixels.x1; x += kSampleBlock, ++blocks)
      sum +=
          samples[static_cast<size_t>(y / kSampleBlock) * kColumns + static_cast<size_t>(x / kSampleBlock)];
  }
  return sum / blocks;
}

double LeastOf(const std::vector<double>& samples) {
  return *std::min_element(samples.begin(), samples.end());
}

void ExpectFinite(const AdaptiveFilm& film) {
  int bad = 0;
  for (const Plane& plane : film.picture) {
    for (int y = 0; y < kFilmHeight; ++y)
      bad += static_cast<int>(std::count_if(plane.Row(y), plane.Row(y) + kFilmWidth,
                                            [](float value) { return !std::isfinite(value); }));
  }
  EXPECT_EQ(bad, 0);
  EXPECT_TRUE(std::isfinite(film.estimated_error));
}

float MostOf(const Picture& picture) {
  float most = 0;
  for (const Plane& plane : picture) {
    for (int y = 0; y < kFilmHeight; ++y)
      most = std::max(most, *std::max_element(plane.Row(y), plane.Row(y) + kFilmWidth));
  }
  return most;
}

/// Of values up to white; of brighter ones, whose noise grows with them, relative to a.
float MostDifference(const Picture& a, const Picture& b) {
  float most = 0;
  for (size_t c = 0; c < a.size(); ++c) {
    for (int y = 0; y < kFilmHeight; ++y) {
      for (int x = 0; x < kFilmWidth; ++x) {
        const float value = a[c].At(x, y);
        most = std::max(most, std::abs(value - b[c].At(x, y)) / std::max(1.0f, value));
      }
    }
  }
  return most;
}

scene::Material Mirror() {
  scene::Material mirror;
  mirror.base.roughness = 0;
  return mirror;
}

constexpr double kBudget = 512;
constexpr double kFloor = 48;  // a tenth of it, rounded down to a step of four

TEST(AdaptiveFilm, ASmallCausticDrawsSamplesAndStarvesNoBlock) {
  const AdaptiveFilm film = Render(CausticRoom(Mirror()), kBudget);
  const std::vector<double> samples = SamplesByBlock(film);
  EXPECT_GE(LeastOf(samples), kFloor);
  EXPECT_NEAR(film.mean_samples, kBudget, 4);
  EXPECT_GT(MeanIn(samples, {28, 32, 44, 48}), 1.25 * MeanIn(samples, {0, 0, 64, 24}))
      << "the ball and the floor around it, which the caustic lies on";
}

TEST(AdaptiveFilm, ALampSeenThroughAKeyholeStarvesNoBlock) {
  constexpr uint64_t kSeeds = 4;
  double around_hole = 0;
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const AdaptiveFilm film =
        Render(KeyholeRoom(0.15f, Lambert({0.5f, 0.5f, 0.5f})), kBudget, 0, nullptr, seed);
    const std::vector<double> samples = SamplesByBlock(film);
    EXPECT_GE(LeastOf(samples), kFloor);
    around_hole += MeanIn(samples, {24, 16, 40, 32}) / kSeeds;
  }
  // With ten seeds 350 to 580: one film tells little.
  EXPECT_GE(around_hole, 0.85 * kBudget);
}

/// A sky of one radiance, or of stripes of two.
Sky SkyOf(float even, float odd) {
  LayeredImage picture(32, 16);
  for (const FloatView& channel : picture.AddColor(layers::kBeauty)) {
    for (int y = 0; y < picture.height(); ++y) {
      for (int x = 0; x < picture.width(); ++x) channel.At(x, y) = x % 2 == 0 ? even : odd;
    }
  }
  return render::Environment::Create(picture, 0, 1).value();
}

TEST(AdaptiveFilm, ABlackFrameEndsEarly) {
  Scene dark;
  dark.materials = {Lambert({0.5f, 0.5f, 0.5f})};
  lumifold::testing::PlaceBoxInside(&dark, 2, {0, 0, 0, 0, 0, 0});
  dark.cameras = {lumifold::testing::LookAt({0, 0, 1.9f}, {0, 0, 0}, 1.2f)};
  for (const double target : {0.0, 0.5}) {
    const AdaptiveFilm film = Render(dark, kBudget, target);
    ExpectFinite(film);
    EXPECT_LE(film.mean_samples, kUniformSamples);
    EXPECT_EQ(film.estimated_error, 0);
    EXPECT_EQ(MostOf(film.picture), 0);
  }
}

TEST(AdaptiveFilm, AFrameOfSkyEndsEarlyWhereItHasNoDetail) {
  // Samples of the sky cost so few rays that only a large budget pays for estimates.
  constexpr double kLargeBudget = 2 * kBudget;
  for (const double target : {0.0, 0.5}) {
    const AdaptiveFilm film = Render(Scene(), kLargeBudget, target, SkyOf(0.5f, 0.5f));
    ExpectFinite(film);
    EXPECT_LE(film.mean_samples, 2 * kUniformSamples);
    EXPECT_EQ(film.estimated_error, 0);
    EXPECT_NEAR(MostOf(film.picture), 0.5f, 1e-6f);
  }
}

TEST(AdaptiveFilm, AFrameOfSkyWithDetailEndsAtTheBudgetOrTheTarget) {
  const AdaptiveFilm film = Render(Scene(), kBudget, 0, SkyOf(0, 1));
  ExpectFinite(film);
  EXPECT_LE(film.mean_samples, kBudget);
  EXPECT_LE(MostOf(film.picture), 1.0001f);
  const AdaptiveFilm ended = Render(Scene(), kBudget, 4, SkyOf(0, 1));
  ExpectFinite(ended);
  EXPECT_LT(ended.mean_samples, film.mean_samples);
  EXPECT_LE(ended.estimated_error, 4);
}

TEST(AdaptiveFilm, TheScaleOfASceneMovesNoSamples) {
  const auto glb = scenes::EncodeGlb(scenes::FindScene("cornell-box")->build());
  ASSERT_TRUE(glb.ok());
  const auto scene = scene::LoadGltf(*glb, "cornell-box", nullptr);
  ASSERT_TRUE(scene.ok());
  const AdaptiveFilm film = Render(*scene, 320);
  const std::vector<double> samples = SamplesByBlock(film);
  ASSERT_GT(*std::max_element(samples.begin(), samples.end()), 2 * LeastOf(samples));
  for (const float factor : {1e-3f, 1e5f}) {
    const AdaptiveFilm scaled = Render(lumifold::testing::Scaled(*scene, factor), 320);
    const std::vector<double> scaled_samples = SamplesByBlock(scaled);
    // Positions are rounded otherwise; that may move a block over the border of a step.
    for (size_t i = 0; i < samples.size(); ++i)
      EXPECT_NEAR(scaled_samples[i], samples[i], job::kSampleStep) << "block " << i << " at " << factor;
    // A step more or less in some blocks moves pixels by a part of their noise.
    EXPECT_LT(MostDifference(film.picture, scaled.picture), 0.02f) << "at " << factor;
  }
}

}  // namespace
}  // namespace lumifold::charts
