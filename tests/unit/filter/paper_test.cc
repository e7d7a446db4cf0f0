#include "filter/baselines/paper.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/shuffling_pool.h"
#include "tests/unit/filter/are_equal.h"
#include "tests/unit/filter/edge_films.h"
#include "tests/unit/filter/is_finite.h"

namespace lumifold::filter {
namespace {

Picture Paper(const LayeredImage& film, const LayeredImage* edges = nullptr, TaskPool* pool = nullptr,
              const std::string& parameters = "") {
  auto picture = FilterFilm(film, "paper:" + parameters, pool, edges);
  EXPECT_TRUE(picture.ok()) << picture.status();
  return *std::move(picture);
}

/// A chequer of single pixels.
float Chequer(int x, int y) { return (x + y) % 2 == 0 ? 0.75f : 0.25f; }

/// A wall under noisy light of mean 1; without noise it is 1 everywhere.
template <typename AlbedoAt>
LayeredImage LitWall(bool is_noisy, const AlbedoAt& albedo_at) {
  LayeredImage film = WallFilm();
  const NoisyLayer direct(std::string(layers::kDirect), &film);
  const NoisyLayer combined(std::string(layers::kNoisy), &film);
  Noise noise;
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    const float a = is_noisy ? noise() : 1.0f;
    const float b = is_noisy ? noise() : 1.0f;
    const float albedo = albedo_at(x, y);
    direct.Set(x, y, a, b);
    Set(film.GetColor(layers::kAlbedo), x, y, albedo);
    combined.Set(x, y, a * albedo, b * albedo);
  });
  return film;
}

TEST(Paper, KeepsTextureUnderConstantLight) {
  const LayeredImage film = LitWall(false, Chequer);
  const Picture picture = Paper(film);
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    ASSERT_NEAR(picture[0].At(x, y), Chequer(x, y), 1e-6f) << x << "," << y;
  });
}

TEST(Paper, FiltersLightAndNotTexture) {
  const LayeredImage white_film = LitWall(true, [](int, int) { return 1.0f; });
  const Picture white = Paper(white_film);
  const Picture textured = Paper(LitWall(true, Chequer));
  double error = 0;
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    // C of the white wall is D: its picture is the filtered light.
    ASSERT_NEAR(textured[1].At(x, y), white[1].At(x, y) * Chequer(x, y), 1e-5f) << x << "," << y;
    error += std::pow(static_cast<double>(white[1].At(x, y)) - 1, 2) / (kWidth * kHeight);
  });
  EXPECT_LT(error, 0.5 * 0.5 * static_cast<double>(kNoise * kNoise));  // half of the noise of the mean
}

TEST(Paper, LeavesAloneWhatIsNoLightOfASurface) {
  LayeredImage film = LitWall(false, Chequer);
  const NoisyLayer combined(std::string(layers::kNoisy), &film);
  AddHalved(std::string(layers::kGlossy), &film);
  film.AddColor(layers::kGlossyAlbedo);
  const NoisyLayer glossy(std::string(layers::kGlossy), &film);
  Noise noise;
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    const float a = noise();
    const float b = noise();
    glossy.Set(x, y, a, b);
    Set(film.GetColor(layers::kGlossyAlbedo), x, y, 0.5f);
    combined.Add(x, y, 0.5f * a + noise(), 0.5f * b + noise());  // and light of no layer
  });
  const Picture picture = Paper(film);
  const ConstColorView noisy = std::as_const(film).GetColor(layers::kNoisy);
  ForEachPixel(kWidth, kHeight,
               [&](int x, int y) { ASSERT_NEAR(picture[2].At(x, y), noisy[2].At(x, y), 1e-6f); });
}

TEST(Paper, FiltersAnyNumberOfSamplesAlike) {
  LayeredImage film = LitWall(true, Chequer);
  const Picture one = Paper(film);
  for (const std::string_view samples : {layers::kSamplesA, layers::kSamplesB})
    for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(samples).Row(y), kWidth, 4096.0f);
  EXPECT_TRUE(AreEqual(Paper(film), one));
}

/// The edge set of EdgeFilm() with `right` of the sub-samples of each pixel on the right surface.
LayeredImage EdgeSetWith(int right) {
  LayeredImage edges = EdgeSet();
  const FloatView normal[2] = {edges.Get(layers::kNormalX), edges.Get(layers::kNormalY)};
  for (int y = 0; y < kHeight; ++y) {
    for (int j = 0; j < kSubSamples; ++j) {
      for (const FloatView& component : normal) component.At(j, y) = 0;
      SetSide(normal, edges.Get(layers::kDistance), j, y, j < right ? 1 : 0);
    }
  }
  return edges;
}

/// D of the edge pixel in row y, as filtered.
float LightOnEdge(const LayeredImage& film, const LayeredImage& edges, int y) {
  const float change =
      Paper(film, &edges)[0].At(kEdgeColumn, y) - film.GetColor(layers::kNoisy)[0].At(kEdgeColumn, y);
  return film.GetColor(layers::kDirect)[0].At(kEdgeColumn, y) +
         change / film.GetColor(layers::kAlbedo)[0].At(kEdgeColumn, y);
}

TEST(Paper, GivesAnEdgePixelTheMeanOverItsSubSamples) {
  const LayeredImage film = EdgeFilm();
  constexpr int kRow = 20;
  const float left = LightOnEdge(film, EdgeSetWith(0), kRow);
  const float right = LightOnEdge(film, EdgeSetWith(kSubSamples), kRow);
  EXPECT_GT(left, 2 * right);  // each is read at its own normal and distance
  for (const int count : {1, 4, 8, 15}) {
    const float share = static_cast<float>(count) / kSubSamples;
    EXPECT_NEAR(LightOnEdge(film, EdgeSetWith(count), kRow), left + share * (right - left), 1e-5f) << count;
  }
}

TEST(Paper, TakesNoLightFromSubSamplesWithoutADiffuseSurface) {
  const LayeredImage film = EdgeFilm();
  constexpr int kRow = 20;
  LayeredImage edges = EdgeSetWith(0);
  const float left = LightOnEdge(film, edges, kRow);
  for (int j = 0; j < 4; ++j) edges.Get(layers::kMask).At(j, kRow) = 0;
  EXPECT_NEAR(LightOnEdge(film, edges, kRow), 0.75f * left, 1e-5f);
}

TEST(Paper, LeavesOutSubSamplesThatNothingIsLike) {
  const LayeredImage film = EdgeFilm();
  constexpr int kRow = 20;
  LayeredImage edges = EdgeSetWith(0);
  const float left = LightOnEdge(film, edges, kRow);
  const FloatView distance = edges.Get(layers::kDistance);
  for (int j = 0; j < 4; ++j) distance.At(j, kRow) = 1e6f;
  EXPECT_NEAR(LightOnEdge(film, edges, kRow), left, 1e-5f);
  for (int j = 0; j < kSubSamples; ++j) distance.At(j, kRow) = 1e6f;
  const float as_filtered = Paper(film)[0].At(kEdgeColumn, kRow);
  EXPECT_EQ(Paper(film, &edges)[0].At(kEdgeColumn, kRow), as_filtered);
}

TEST(Paper, StaysFiniteWhateverTheEdgeSetHolds) {
  const LayeredImage film = EdgeFilm();
  for (const float poison : {NAN, INFINITY, -1e38f}) {
    LayeredImage edges = EdgeSet();
    for (const std::string_view name : {layers::kNormalX, layers::kDistance, layers::kMask}) {
      for (int y = 0; y < kHeight; y += 3) edges.Get(name).At(y % kSubSamples, y) = poison;
    }
    EXPECT_TRUE(IsFinite(Paper(film, &edges))) << poison;
  }
}

TEST(Paper, IsTheSameForAnyPool) {
  const LayeredImage film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  ShufflingPool pool(5);
  EXPECT_TRUE(AreEqual(Paper(film, &edges, &pool), Paper(film, &edges)));
}

TEST(Paper, FollowsEachOfItsParameters) {
  const LayeredImage film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const Picture usual = Paper(film, &edges);
  for (const char* parameters : {"sigma_s=8", "sigma_q=1.8", "sigma_q=0"})
    EXPECT_FALSE(AreEqual(Paper(film, &edges, nullptr, parameters), usual)) << parameters;
  EXPECT_TRUE(AreEqual(Paper(film, &edges, nullptr, "sigma_q=1.8,sigma_s=8"),
                       Paper(film, &edges, nullptr, "sigma_s=8,sigma_q=1.8")));
}

// The whole picture is a mirror of 0.9 that shows a grey wall, which the light 2 falls on, and a mirror of
// 0.5 in it that shows another: F = 0.9 (2 * 0.4 + 0.5 * (3 * 0.8)).
struct Seen {
  layers::Level level;
  float light;
  float throughput;  // of the chain of mirrors, times the wall's albedo
};
constexpr Seen kSeen[] = {{{layers::Branch::kReflection, 1}, 2, 0.9f * 0.4f},
                          {{layers::Branch::kReflection, 2}, 3, 0.9f * 0.5f * 0.8f}};

void AddSeen(const Seen& seen, LayeredImage* film) {
  for (const std::string_view layer : layers::kLevelHalved)
    AddHalved(layers::OfLevel(seen.level, layer), film);
  for (const std::string_view layer : layers::kLevelWhole) film->AddColor(layers::OfLevel(seen.level, layer));
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB})
    film->Add(layers::OfLevel(seen.level, name));
  for (const std::string& name : layers::LevelFeatureChannels(seen.level)) film->Add(name);
  const auto fill = [&](std::string_view name, float value) {
    const FloatView plane = film->Get(layers::OfLevel(seen.level, name));
    ForEachPixel(kWidth, kHeight, [&](int x, int y) { plane.At(x, y) = value; });
  };
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB, layers::kMask, layers::kNormalX})
    fill(name, 1);
  fill(layers::kDistance, 2 + 2 * static_cast<float>(seen.level.depth));
  Noise noise(static_cast<uint32_t>(seen.level.depth));
  const NoisyLayer light(layers::OfLevel(seen.level, layers::kDirect), film);
  const NoisyLayer combined(std::string(layers::kNoisy), film);
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    const float a = seen.light * noise();
    const float b = seen.light * noise();
    light.Set(x, y, a, b);
    Set(film->GetColor(layers::OfLevel(seen.level, layers::kAlbedo)), x, y, seen.throughput);
    combined.Add(x, y, seen.throughput * a, seen.throughput * b);
  });
}

double ErrorOfMirror(const ConstFloatView& picture) {
  constexpr float kTruth = 0.9f * (2 * 0.4f + 0.5f * (3 * 0.8f));
  double sum = 0;
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    sum += std::pow(static_cast<double>(picture.At(x, y) - kTruth), 2) / (kWidth * kHeight);
  });
  return sum;
}

TEST(Paper, FiltersWhatMirrorsShowLevelByLevel) {
  LayeredImage film = WallFilm();
  for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(layers::kMask).Row(y), kWidth, 0.0f);
  for (const Seen& seen : kSeen) AddSeen(seen, &film);
  const Picture picture = Paper(film);
  const double noisy = ErrorOfMirror(std::as_const(film).GetColor(layers::kNoisy)[0]);
  EXPECT_LT(ErrorOfMirror(picture[0].view()), 0.05 * noisy);
  // Neither level alone is enough.
  for (const Seen& seen : kSeen) {
    LayeredImage without = film.Crop(film.bounds());
    const FloatView count_a = without.Get(layers::OfLevel(seen.level, layers::kSamplesA));
    const FloatView count_b = without.Get(layers::OfLevel(seen.level, layers::kSamplesB));
    for (const FloatView& count : {count_a, count_b})
      for (int y = 0; y < kHeight; ++y) std::fill_n(count.Row(y), kWidth, 0.0f);
    EXPECT_GT(ErrorOfMirror(Paper(without)[0].view()), 0.1 * noisy);
  }
}

}  // namespace
}  // namespace lumifold::filter
