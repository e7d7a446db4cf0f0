#include "tests/charts/methods/samples/sample_method.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/metrics/metrics.h"
#include "server/film/film_builder.h"
#include "tests/support/analytic_scenes.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::charts {
namespace {

std::unique_ptr<render::Renderer> RoomRenderer(const FilmSettings& settings) {
  render::RenderSettings room;
  room.width = settings.width;
  room.height = settings.height;
  room.seed = settings.seed;
  auto renderer = render::Renderer::Create(std::make_shared<const scene::Scene>(testing::SmallRoom()), room);
  EXPECT_TRUE(renderer.ok()) << renderer.status();
  return *std::move(renderer);
}

LayeredImage FilmOf(const render::Renderer& renderer, const FilmSettings& settings) {
  const Rect frame = {0, 0, settings.width, settings.height};
  render::RenderCounts counts;
  film::TileSums sums;
  sums.Add(renderer.RenderPass(frame, 0, {0, settings.samples}, &counts));
  film::FilmBuilder film(settings.width, settings.height);
  film.SetMeans(frame, sums);
  film.SetGeometry(frame, renderer.RenderGeometry(frame, 0).pixels);
  return std::move(film.Take().pixels);
}

/// A traced room and the film of its samples.
struct Room {
  LayeredImage film;
  SampleSet set;
};

std::unique_ptr<Room> TraceRoom(const FilmSettings& settings, TaskPool* pool = nullptr) {
  const auto renderer = RoomRenderer(settings);
  auto room = std::make_unique<Room>();
  room->film = FilmOf(*renderer, settings);
  absl::StatusOr<SampleSet> set = TraceSampleSet(*renderer, settings, room->film, pool);
  EXPECT_TRUE(set.ok()) << set.status();
  room->set = *std::move(set);
  return room;
}

Picture Filter(const SampleMethod& method, const SampleSet& set, TaskPool* pool = nullptr) {
  absl::StatusOr<Picture> picture = method.filter(set, filter::DefaultsOf(method.info), pool);
  EXPECT_TRUE(picture.ok()) << method.info.name << ": " << picture.status();
  return *std::move(picture);
}

const SampleMethod& MethodCalled(std::string_view name) {
  for (const SampleMethod& method : SampleMethods()) {
    if (method.info.name == name) return method;
  }
  ADD_FAILURE() << "no method is called " << name;
  return SampleMethods().front();
}

ConstColorView ViewOf(const Picture& picture) {
  return {picture[0].view(), picture[1].view(), picture[2].view()};
}

ConstColorView NoisyOf(const LayeredImage& film) { return film.GetColor(layers::kNoisy); }

/// A film and samples of one lit wall: D = 0.6, I = 0.2, T = 0.5, C = 0.4.
std::unique_ptr<Room> OneWall(int width, int height, uint32_t samples) {
  auto room = std::make_unique<Room>();
  LayeredImage& film = room->film;
  film = LayeredImage(width, height);
  const auto add = [&](std::string_view layer, float value) {
    for (const FloatView& channel : film.AddColor(layer)) {
      for (int y = 0; y < height; ++y) std::fill_n(channel.Row(y), width, value);
    }
  };
  for (const auto& [layer, value] :
       {std::pair{layers::kNoisy, 0.4f}, {layers::kDirect, 0.6f}, {layers::kIndirect, 0.2f}}) {
    for (const std::string& name : {std::string(layer), layers::HalfA(layer), layers::HalfB(layer)})
      add(name, value);
  }
  add(layers::kAlbedo, 0.5f);
  add(layers::kEmission, 0);
  for (const auto& [name, value] : {std::pair{layers::kNormalX, 0.0f},
                                    {layers::kNormalY, 0.0f},
                                    {layers::kNormalZ, 1.0f},
                                    {layers::kDistance, 2.0f},
                                    {layers::kMask, 1.0f},
                                    {layers::kSamplesA, 0.5f * static_cast<float>(samples)},
                                    {layers::kSamplesB, 0.5f * static_cast<float>(samples)}}) {
    Plane plane(width, height);
    plane.Fill(value);
    film.Add(name, std::move(plane));
  }
  SampleSet& set = room->set;
  set.width = width;
  set.height = height;
  set.samples_per_pixel = samples;
  set.film = &film;
  set.guide = LayeredImage(width, height);
  for (const std::string_view layer : {layers::kDirect, layers::kIndirect}) set.guide.AddColor(layer);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  for (int i = 0; i < width * height; ++i) {
    for (uint32_t k = 0; k < samples; ++k) {
      ChartSample s;
      const int x = i % width;
      const int y = i / width;
      s.point = {static_cast<float>(x) + uniform(random), static_cast<float>(y) + uniform(random)};
      s.radiance = {0.4f, 0.4f, 0.4f};
      s.direct = {0.6f, 0.6f, 0.6f};
      s.indirect = {0.2f, 0.2f, 0.2f};
      s.albedo = {0.5f, 0.5f, 0.5f};
      s.position = {s.point.x, s.point.y, 2};
      s.normal = {0, 0, 1};
      s.distance = 2;
      for (scene::Vec2& pair : s.random) pair = {uniform(random), uniform(random)};
      set.samples.push_back(s);
    }
  }
  return room;
}

TEST(SampleSet, HoldsTheSamplesItsFilmIsMadeOf) {
  const FilmSettings settings = {21, 13, 5, 4};
  const auto room = TraceRoom(settings);
  const ConstColorView noisy = NoisyOf(room->film);
  for (int y = 0; y < settings.height; ++y) {
    for (int x = 0; x < settings.width; ++x) {
      float sum = 0;
      for (uint32_t i = 0; i < settings.samples; ++i) {
        const ChartSample& sample = room->set.At(x, y, i);
        sum += sample.radiance.y;
        EXPECT_EQ(static_cast<int>(sample.point.x), x);
        EXPECT_EQ(static_cast<int>(sample.point.y), y);
      }
      ASSERT_NEAR(sum / 5, noisy[1].At(x, y), 1e-5f * (1 + noisy[1].At(x, y)));
    }
  }
}

TEST(SampleSet, SaysWhyItCannotBeTraced) {
  const FilmSettings settings = {8, 8, 2, 1};
  const auto renderer = RoomRenderer(settings);
  EXPECT_EQ(TraceSampleSet(*renderer, settings, LayeredImage(8, 7), nullptr).status().code(),
            absl::StatusCode::kInvalidArgument);
  const FilmSettings many = {8, 8, 1u << 20, 1};
  EXPECT_EQ(TraceSampleSet(*renderer, many, LayeredImage(8, 8), nullptr).status().code(),
            absl::StatusCode::kResourceExhausted);
}

TEST(SampleMethod, KeepsAPictureOfOneValue) {
  const auto room = OneWall(24, 20, 4);
  for (const SampleMethod& method : SampleMethods()) {
    const Picture picture = Filter(method, room->set);
    for (const Plane& plane : picture) {
      for (int y = 0; y < 20; ++y) {
        for (int x = 0; x < 24; ++x)
          ASSERT_NEAR(plane.At(x, y), 0.4f, 2e-5f) << method.info.name << ": " << x << "," << y;
      }
    }
  }
}

TEST(SampleMethod, TakesNoiseOut) {
  const FilmSettings settings = {64, 48, 2, 5};  // with more, the bias of some is larger than the noise
  const auto room = TraceRoom(settings);
  const auto renderer = RoomRenderer({64, 48, 256, 777});
  const LayeredImage truth = FilmOf(*renderer, {64, 48, 256, 777});
  const double noisy = metrics::Mse255(NoisyOf(room->film), NoisyOf(truth));
  for (const SampleMethod& method : SampleMethods()) {
    const double error = metrics::Mse255(ViewOf(Filter(method, room->set)), NoisyOf(truth));
    EXPECT_LT(error, noisy) << method.info.name;
  }
}

TEST(SampleMethod, GivesTheSameBitsForAnyPool) {
  ShufflingPool pool(9);
  const auto alone = TraceRoom({20, 36, 4, 6});
  const auto shuffled = TraceRoom({20, 36, 4, 6}, &pool);
  for (const SampleMethod& method : SampleMethods()) {
    const Picture a = Filter(method, alone->set);
    const Picture b = Filter(method, shuffled->set, &pool);
    for (size_t c = 0; c < 3; ++c) {
      for (int y = 0; y < 36; ++y) {
        for (int x = 0; x < 20; ++x) ASSERT_EQ(a[c].At(x, y), b[c].At(x, y)) << method.info.name;
      }
    }
  }
}

TEST(SampleMethod, StaysFiniteAtBothLimitsOfEachParameter) {
  for (const FilmSettings& settings : {FilmSettings{12, 10, 2, 6}, FilmSettings{1, 1, 1, 7}}) {
    const auto room = TraceRoom(settings);
    for (const SampleMethod& method : SampleMethods()) {
      for (size_t i = 0; i < method.info.parameters.size(); ++i) {
        for (const float value : {method.info.parameters[i].least, method.info.parameters[i].most}) {
          std::vector<float> values = filter::DefaultsOf(method.info);
          values[i] = value;
          const absl::StatusOr<Picture> picture = method.filter(room->set, values, nullptr);
          ASSERT_TRUE(picture.ok()) << picture.status();
          for (int y = 0; y < settings.height; ++y) {
            for (int x = 0; x < settings.width; ++x)
              ASSERT_TRUE(std::isfinite((*picture)[1].At(x, y))) << method.info.name << " " << value;
          }
        }
      }
    }
  }
}

TEST(SampleMethod, HasDefaultsAndGridsWithinItsLimits) {
  for (const SampleMethod& method : SampleMethods()) {
    for (const filter::MethodParameter& p : method.info.parameters) {
      EXPECT_THAT(p.grid, ::testing::Each(::testing::AllOf(::testing::Ge(p.least), ::testing::Le(p.most))))
          << method.info.name << ": " << p.name;
      EXPECT_THAT(p.grid, ::testing::Contains(p.default_value)) << method.info.name << ": " << p.name;
    }
  }
}

/// Sum over all pixels of one channel.
double EnergyOf(const ConstFloatView& plane) {
  double sum = 0;
  ForEachPixel(plane.width(), plane.height(),
               [&](int x, int y) { sum += static_cast<double>(plane.At(x, y)); });
  return sum;
}

TEST(Epanechnikov, LosesNoEnergy) {
  const auto room = TraceRoom({30, 20, 4, 8});
  const Picture picture = Filter(MethodCalled("epanechnikov"), room->set);
  const double before = EnergyOf(NoisyOf(room->film)[1]);
  EXPECT_NEAR(EnergyOf(picture[1].view()), before, 1e-5 * before);
}

TEST(Epanechnikov, SpreadsASpikeByItsParabola) {
  const auto room = OneWall(15, 15, 1);
  for (ChartSample& sample : room->set.samples) sample.radiance = {};
  constexpr float kSpike = 490;  // the pilot is a 49th of it: with scale 0.5 the radius is 0.5 sqrt(49) = 3.5
  room->set.samples[7 * 15 + 7].radiance = {kSpike, kSpike, kSpike};
  const SampleMethod& method = MethodCalled("epanechnikov");
  const absl::StatusOr<Picture> picture = method.filter(room->set, {0.5f, 16, 3}, nullptr);
  ASSERT_TRUE(picture.ok());
  double total = 0;
  const auto weight = [](int dx, int dy) { return std::max(0.0, 1 - (dx * dx + dy * dy) / 12.25); };
  for (int dy = -4; dy <= 4; ++dy) {
    for (int dx = -4; dx <= 4; ++dx) total += weight(dx, dy);
  }
  ForEachPixel(15, 15, [&](int x, int y) {
    EXPECT_NEAR(static_cast<double>((*picture)[0].At(x, y)), 490 * weight(x - 7, y - 7) / total, 1e-3)
        << x << "," << y;
  });
}

/// Sets D of a film's pixel, its halves and C.
void SetDirect(int x, int y, float direct, LayeredImage* film) {
  for (const std::string_view layer : {layers::kDirect, layers::kNoisy}) {
    const float value = layer == layers::kDirect ? direct : (direct + 0.2f) * 0.5f;
    for (const std::string& name : {std::string(layer), layers::HalfA(layer), layers::HalfB(layer)}) {
      for (const FloatView& channel : film->GetColor(name)) channel.At(x, y) = value;
    }
  }
}

TEST(GuidedRays, KeepAShadowThatTheirLightShows) {
  const auto room = OneWall(40, 24, 2);
  ForEachPixel(20, 24, [&](int x, int y) { SetDirect(x, y, 0, &room->film); });
  const SampleMethod& method = MethodCalled("guided-rays");
  const float blurred = Filter(method, room->set)[0].At(19, 12);
  for (const FloatView& channel : room->set.guide.GetColor(layers::kDirect)) {
    for (int y = 0; y < 24; ++y) std::fill_n(channel.Row(y) + 20, 20, 1.0f);
  }
  const float kept = Filter(method, room->set)[0].At(19, 12);
  EXPECT_GT(blurred, 0.2f);
  EXPECT_NEAR(kept, 0.1f, 0.01f);
}

TEST(GuidedRays, AreTheSameHoweverTheFrameIsCut) {
  const auto renderer = RoomRenderer({37, 20, 1, 4});
  const LayeredImage whole = render::ChartsAccess(*renderer).RenderGuide({0, 0, 37, 20}, 0);
  const LayeredImage part = render::ChartsAccess(*renderer).RenderGuide({5, 3, 30, 17}, 0);
  for (const LayeredImage::Channel& channel : part.channels()) {
    for (int y = 0; y < 14; ++y) {
      for (int x = 0; x < 25; ++x)
        ASSERT_EQ(channel.plane.At(x, y), whole.Get(channel.name).At(x + 5, y + 3)) << channel.name;
    }
  }
}

TEST(GuidedRays, NeedNoSamples) {
  const auto room = TraceRoom({20, 14, 4, 3});
  const auto renderer = RoomRenderer({20, 14, 4, 3});
  const absl::StatusOr<SampleSet> none = TraceSampleSet(*renderer, {20, 14, 0, 3}, room->film, nullptr);
  ASSERT_TRUE(none.ok()) << none.status();
  for (const SampleMethod& method : SampleMethods()) {
    if (method.uses_samples) continue;
    EXPECT_EQ(Filter(method, *none)[1].At(9, 7), Filter(method, room->set)[1].At(9, 7)) << method.info.name;
  }
}

/// The mean squared difference of adjacent pixels, over their mean square.
double RoughnessOf(const ConstFloatView& plane) {
  double differences = 0;
  double squares = 0;
  for (int y = 0; y < plane.height(); ++y) {
    for (int x = 0; x + 1 < plane.width(); ++x) {
      const double difference = static_cast<double>(plane.At(x, y) - plane.At(x + 1, y));
      differences += difference * difference;
      squares += static_cast<double>(plane.At(x, y)) * static_cast<double>(plane.At(x, y));
    }
  }
  return differences / squares;
}

TEST(GuidedRays, AreSmootherThanSamplesAsMany) {
  const FilmSettings settings = {64, 48, 1, 4};
  const auto renderer = RoomRenderer(settings);
  const LayeredImage guide = render::ChartsAccess(*renderer).RenderGuide({0, 0, 64, 48}, 0);
  const LayeredImage film = FilmOf(*renderer, settings);
  EXPECT_LT(RoughnessOf(guide.GetColor(layers::kDirect)[1]),
            0.5 * RoughnessOf(film.GetColor(layers::kDirect)[1]));
}

/// A wall: D = 3 in every sample of the left half, 0.6 in one of eight samples of the right half.
std::unique_ptr<Room> HalfRarelyLitWall() {
  auto room = OneWall(32, 16, 8);
  for (size_t i = 0; i < room->set.samples.size(); ++i) {
    const bool is_left = i / 8 % 32 < 16;
    const float direct = is_left ? 3.0f : (i % 8 == 0 ? 4.8f : 0.0f);
    const float radiance = (direct + 0.2f) * 0.5f;
    room->set.samples[i].direct = {direct, direct, direct};
    room->set.samples[i].radiance = {radiance, radiance, radiance};
  }
  return room;
}

TEST(Probabilistic, WeighsByPoissonsDistribution) {
  const auto room = HalfRarelyLitWall();
  const absl::StatusOr<Picture> picture =
      MethodCalled("probabilistic").filter(room->set, {1, 0.25f}, nullptr);
  ASSERT_TRUE(picture.ok());
  // The counts are 8 and 1 of 8. A count of 8 given a rate of 1 is the less likely one, 1 / 8! over 1 / 1!;
  // its fourth root is large enough to be visible.
  const double likelihood = std::pow(1.0 / 40320.0, 0.25);
  const double side = std::exp(-2.0);  // the kernel one pixel off
  const double corner = std::exp(-4.0);
  const double same = 1 + 3 * side + 2 * corner;          // the column itself, and the one on its side
  const double other = likelihood * (side + 2 * corner);  // the column across the border
  const double direct = (same * 3 + other * 0.6) / (same + other);
  EXPECT_NEAR(static_cast<double>((*picture)[0].At(15, 8)), 0.5 * (direct + 0.2), 1e-4);
}

TEST(Probabilistic, TellsLightThatComesRarelyFromLightThatComesAlways) {
  const auto room = HalfRarelyLitWall();
  const Picture picture = Filter(MethodCalled("probabilistic"), room->set);
  EXPECT_NEAR(picture[0].At(14, 8), 1.6f, 0.01f);
  EXPECT_NEAR(picture[0].At(17, 8), 0.4f, 0.01f);
}

/// Two pixels of four samples each, whose transformed radiance is a mean +-0.01 by turns: 1 and 1 + `step`.
std::unique_ptr<Room> TwoPixels(float step) {
  auto room = OneWall(2, 1, 4);
  for (size_t i = 0; i < room->set.samples.size(); ++i) {
    const float transformed = (i < 4 ? 1.0f : 1.0f + step) + (i % 2 == 0 ? 0.01f : -0.01f);
    const float root = 1 + transformed / 2;
    room->set.samples[i].radiance = {root * root, root * root, root * root};
  }
  return room;
}

TEST(Statistical, MixesWhatTheTestDoesNotTellApart) {
  // The quantile of Student's t of six degrees of freedom at .9975 is 4.3168, the variance of each mean
  // .01^2 / 3: means are told apart from a step of 4.3168 sqrt(2/3) .01 = .03525 on.
  const auto difference = [](const Picture& picture) { return picture[0].At(1, 0) - picture[0].At(0, 0); };
  const float weight = std::exp(-0.5f / 100);  // of the neighbour, by its place
  for (const auto& [step, mixes] : {std::pair{0.0349f, true}, {0.0356f, false}}) {
    const auto room = TwoPixels(step);
    const float apart = 1.5f * step + step * step / 4;  // of the light; the transform's inverse
    const float expected = mixes ? apart * (1 - weight) / (1 + weight) : apart;
    EXPECT_NEAR(difference(Filter(MethodCalled("statistical"), room->set)), expected, 1e-4f) << step;
  }
}

TEST(Statistical, LeavesSingleSamples) {
  const auto room = OneWall(3, 2, 1);
  room->set.samples[4].radiance = {7, 8, 9};
  EXPECT_EQ(Filter(MethodCalled("statistical"), room->set)[2].At(1, 1), 9);
}

}  // namespace
}  // namespace lumifold::charts
