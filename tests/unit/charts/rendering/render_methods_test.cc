// Properties of every method of tests/charts/methods/rendering.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/metrics/metrics.h"
#include "tests/charts/methods/rendering/render_method.h"
#include "tests/support/analytic_scenes.h"
#include "tests/support/shuffling_pool.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::charts {
namespace {

using render::MakeRenderer;
using render::RenderAll;
using render::RenderSettings;
using render::SettingsOf;

RenderedPicture Render(const RenderMethod& method, const scene::Scene& scene, const RenderSettings& settings,
                       uint32_t samples, TaskPool* pool = nullptr) {
  absl::StatusOr<RenderedPicture> out = method.render(std::make_shared<scene::Scene>(scene), settings,
                                                      samples, filter::DefaultsOf(method.info), pool);
  EXPECT_TRUE(out.ok()) << method.info.name << ": " << out.status();
  return *std::move(out);
}

double Mean(const ConstColorView& picture) {
  double sum = 0;
  for (const ConstFloatView& plane : picture) {
    ForEachPixel(plane.width(), plane.height(),
                 [&](int x, int y) { sum += static_cast<double>(plane.At(x, y)); });
  }
  return sum / (3.0 * picture[0].width() * picture[0].height());
}

double Mean(const RenderedPicture& out) { return Mean(ViewOf(out.picture)); }

scene::Scene GlowingBox(float albedo, float emission) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({albedo, albedo, albedo})};
  scene.materials[0].emission.radiance = {emission, emission, emission};
  testing::PlaceBoxInside(&scene, 1, {0, 0, 0, 0, 0, 0});
  scene.cameras = {testing::LookAt({0.3f, 0, 0.2f}, {0, -1, 0.1f}, 1)};
  return scene;
}

TEST(RenderMethods, AreFoundByName) {
  for (const RenderMethod& method : RenderMethods()) EXPECT_EQ(FindRenderMethod(method.info.name), &method);
  EXPECT_EQ(FindRenderMethod("nothing"), nullptr);
}

TEST(RenderMethods, HaveDefaultsAndGridsWithinTheirLimits) {
  for (const RenderMethod& method : RenderMethods()) {
    for (const filter::MethodParameter& p : method.info.parameters) {
      EXPECT_THAT(p.grid, ::testing::Each(::testing::AllOf(::testing::Ge(p.least), ::testing::Le(p.most))))
          << method.info.name << ": " << p.name;
      EXPECT_THAT(p.grid, ::testing::Contains(p.default_value)) << method.info.name << ": " << p.name;
    }
  }
}

TEST(RenderMethods, SayWhatIsWrong) {
  RenderSettings settings = SettingsOf(4, 4);
  settings.camera = "nowhere";
  for (const RenderMethod& method : RenderMethods()) {
    const auto out = method.render(std::make_shared<scene::Scene>(testing::SmallRoom()), settings, 1,
                                   filter::DefaultsOf(method.info), nullptr);
    EXPECT_EQ(out.status().code(), absl::StatusCode::kNotFound) << method.info.name;
  }
}

TEST(RenderMethods, GiveTheSameBitsForAnyPool) {
  const RenderSettings settings = SettingsOf(24, 17, 3);
  for (const RenderMethod& method : RenderMethods()) {
    ShufflingPool shuffled(5);
    const std::unique_ptr<TaskPool> two = MakeTaskPool(2);
    const RenderedPicture alone = Render(method, testing::SmallRoom(), settings, 8);
    for (TaskPool* pool : {static_cast<TaskPool*>(&shuffled), two.get()}) {
      const RenderedPicture other = Render(method, testing::SmallRoom(), settings, 8, pool);
      EXPECT_EQ(alone.gather_paths, other.gather_paths);
      for (size_t c = 0; c < 3; ++c) {
        for (int y = 0; y < 17; ++y) {
          for (int x = 0; x < 24; ++x)
            ASSERT_EQ(alone.picture[c].At(x, y), other.picture[c].At(x, y)) << method.info.name;
        }
      }
    }
  }
}

TEST(RenderMethods, ReachTheLightOfAGlowingBox) {
  // Radiance after b bounces beyond the first surface: emission times the sum of albedo powers up to b + 1.
  const double expected = 0.5 * (1 + 0.6 + 0.36 + 0.216);
  for (const RenderMethod& method : RenderMethods()) {
    const RenderedPicture out = Render(method, GlowingBox(0.6f, 0.5f), SettingsOf(24, 24, 2), 32);
    EXPECT_NEAR(Mean(out) / expected, 1, 0.01) << method.info.name;
  }
}

/// A reference of a room, and errors against it.
class RoomTruth {
 public:
  RoomTruth()
      : reference_(
            MeansOf(RenderAll(*MakeRenderer(testing::SmallRoom(), settings()), kWidth, kHeight, 768))) {}

  static RenderSettings settings(uint64_t seed = 0) {
    RenderSettings settings = SettingsOf(kWidth, kHeight, 4);
    settings.seed = seed;
    return settings;
  }

  double mean() const { return Mean(reference_.GetColor(layers::kNoisy)); }
  double ErrorOf(const RenderedPicture& out) const {
    return metrics::Mse255(ViewOf(out.picture), reference_.GetColor(layers::kNoisy));
  }
  double ErrorOf(const LayeredImage& sums) const {
    const LayeredImage picture = MeansOf(sums);
    return metrics::Mse255(picture.GetColor(layers::kNoisy), reference_.GetColor(layers::kNoisy));
  }

  static constexpr int kWidth = 32;
  static constexpr int kHeight = 24;

  /// The means of a pass.
  static LayeredImage MeansOf(const LayeredImage& sums) {
    LayeredImage picture(kWidth, kHeight);
    const ConstColorView a = sums.GetColor(layers::HalfA(layers::kNoisy));
    const ConstColorView b = sums.GetColor(layers::HalfB(layers::kNoisy));
    const ColorView out = picture.AddColor(layers::kNoisy);
    for (size_t c = 0; c < 3; ++c) {
      ForEachPixel(kWidth, kHeight, [&](int x, int y) {
        const float count = sums.Get(layers::kSamplesA).At(x, y) + sums.Get(layers::kSamplesB).At(x, y);
        out[c].At(x, y) = (a[c].At(x, y) + b[c].At(x, y)) / count;
      });
    }
    return picture;
  }

 private:
  const LayeredImage reference_;
};

TEST(RenderMethods, ComeCloseToThePathTracerInARoom) {
  const RoomTruth truth;
  for (const RenderMethod& method : RenderMethods()) {
    const RenderedPicture out = Render(method, testing::SmallRoom(), RoomTruth::settings(3), 64);
    EXPECT_NEAR(Mean(out) / truth.mean(), 1, 0.03) << method.info.name;
  }
}

TEST(RenderMethods, BeatThePathTracerAtEqualCameraSamples) {
  const RoomTruth truth;
  const RenderSettings settings = RoomTruth::settings(3);
  const double plain = truth.ErrorOf(
      RenderAll(*MakeRenderer(testing::SmallRoom(), settings), RoomTruth::kWidth, RoomTruth::kHeight, 32));
  for (const RenderMethod& method : RenderMethods()) {
    if (method.info.name == "mdas") continue;  // cannot tell the noise of light paths from detail
    EXPECT_LT(truth.ErrorOf(Render(method, testing::SmallRoom(), settings, 32)), plain) << method.info.name;
  }
}

TEST(RenderMethods, OfManyDimensionsBeatThePathTracerThroughALens) {
  scene::Scene scene;
  scene.materials = {testing::Emitter({0.8f, 0.8f, 0.8f}), testing::Emitter({0.1f, 0.2f, 0.3f})};
  testing::Place(&scene, testing::QuadMesh({-9, -9, -4}, {18, 0, 0}, {0, 18, 0}, 1));
  for (int i = -3; i <= 3; ++i)
    testing::Place(&scene,
                   testing::QuadMesh({0.5f * static_cast<float>(i), -3, -2}, {0.2f, 0.1f, 0}, {0, 6, 0}, 0));
  scene.cameras = {testing::LookAt({0, 0, 1}, {0, 0, 0}, 0.8f)};
  RenderSettings settings = RoomTruth::settings(2);
  settings.lens = {.f_stop = 0.01f, .focus_metres = 5};
  const auto error = [&](const ConstColorView& picture, const LayeredImage& truth) {
    return metrics::Mse255(picture, truth.GetColor(layers::kNoisy));
  };
  const auto render = [&](uint32_t samples) {
    return RoomTruth::MeansOf(
        RenderAll(*MakeRenderer(scene, settings), RoomTruth::kWidth, RoomTruth::kHeight, samples));
  };
  const LayeredImage plain = render(8);
  settings.seed = 3;
  const LayeredImage truth = render(1024);
  settings.seed = 2;
  const RenderedPicture adaptive = Render(*FindRenderMethod("mdas"), scene, settings, 8);
  const double of_plain = error(std::as_const(plain).GetColor(layers::kNoisy), truth);
  const double of_adaptive = error(ViewOf(adaptive.picture), truth);
  EXPECT_LT(of_adaptive, of_plain);
}

TEST(RenderMethods, TakeAboutAsManySamplesAsTheyMay) {
  const RenderSettings settings = SettingsOf(16, 12, 2);
  for (const RenderMethod& method : RenderMethods()) {
    for (const uint32_t samples : {1u, 7u, 16u}) {
      const RenderedPicture out = Render(method, testing::SmallRoom(), settings, samples);
      const double budget = 16.0 * 12 * samples;
      EXPECT_LE(static_cast<double>(out.camera_paths), budget) << method.info.name << " " << samples;
      EXPECT_GE(static_cast<double>(out.camera_paths), 0.9 * budget) << method.info.name << " " << samples;
    }
  }
}

TEST(RenderMethods, StayFiniteInTheDarkAndOnOnePixel) {
  scene::Scene dark = testing::SmallRoom();
  for (scene::Material& material : dark.materials) material.emission.radiance = {};
  for (const RenderMethod& method : RenderMethods()) {
    EXPECT_EQ(Mean(Render(method, dark, SettingsOf(9, 5, 2), 4)), 0) << method.info.name;
    EXPECT_TRUE(std::isfinite(Mean(Render(method, testing::SmallRoom(), SettingsOf(1, 1, 2), 2))))
        << method.info.name;
  }
}

TEST(RenderMethods, SeeTheSkyWhereNothingIs) {
  scene::Scene empty;
  empty.cameras = {testing::LookAt({0, 0, 0}, {0, 0, -1}, 1)};
  RenderSettings settings = SettingsOf(8, 6);
  for (const RenderMethod& method : RenderMethods())
    EXPECT_EQ(Mean(Render(method, empty, settings, 4)), 0) << method.info.name;
}

}  // namespace
}  // namespace lumifold::charts
