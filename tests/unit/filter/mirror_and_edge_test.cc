#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <string>
#include <utility>

#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/manifold/denoise.h"
#include "filter/methods.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::filter {
namespace {

constexpr int kWidth = 96;
constexpr int kHeight = 64;
constexpr float kNoise = 0.7f;  // relative deviation of a half
constexpr layers::Level kMirror = {layers::Branch::kReflection, 1};

void Set(const ColorView& color, int x, int y, float value) {
  for (const FloatView& channel : color) channel.At(x, y) = value;
}

void AddHalved(const std::string& layer, LayeredImage* film) {
  for (const std::string& name : {layer, layers::HalfA(layer), layers::HalfB(layer)}) film->AddColor(name);
}

/// An empty film, one wall at distance 2 all over it.
LayeredImage WallFilm() {
  LayeredImage film(kWidth, kHeight);
  for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect})
    AddHalved(std::string(layer), &film);
  for (const std::string_view layer : {layers::kAlbedo, layers::kEmission}) film.AddColor(layer);
  for (const std::string_view name : {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance,
                                      layers::kMask, layers::kSamplesA, layers::kSamplesB})
    film.Add(name);
  for (const std::string_view name : {layers::kNormalZ, layers::kMask, layers::kSamplesA, layers::kSamplesB})
    for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(name).Row(y), kWidth, 1.0f);
  for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(layers::kDistance).Row(y), kWidth, 2.0f);
  return film;
}

/// Writes a noisy layer into its mean and halves.
class NoisyLayer {
 public:
  NoisyLayer(const std::string& layer, LayeredImage* film)
      : mean_(film->GetColor(layer)),
        a_(film->GetColor(layers::HalfA(layer))),
        b_(film->GetColor(layers::HalfB(layer))) {}

  void Set(int x, int y, float a, float b) const {
    filter::Set(a_, x, y, a);
    filter::Set(b_, x, y, b);
    filter::Set(mean_, x, y, 0.5f * (a + b));
  }
  void Add(int x, int y, float a, float b) const { Set(x, y, a_[0].At(x, y) + a, b_[0].At(x, y) + b); }

 private:
  ColorView mean_, a_, b_;
};

class Noise {
 public:
  float operator()() {
    return std::gamma_distribution<float>(1 / (kNoise * kNoise), kNoise * kNoise)(random_);
  }

 private:
  std::mt19937 random_{11};
};

std::array<Plane, 3> Filtered(const LayeredImage& film, const LayeredImage* edges, TaskPool* pool = nullptr) {
  auto picture = FilterFilm(film, "default", pool, edges);
  EXPECT_TRUE(picture.ok()) << picture.status();
  return *std::move(picture);
}

// A mirror in the wall shows two lit surfaces that meet at column 48.

constexpr Rect kMirrorRect = {30, 16, 66, 48};
constexpr float kReflectance = 0.9f;

float SeenInMirror(int x) { return x < 48 ? 1.0f : 0.25f; }

void AddMirrorPixel(int x, int y, Noise* noise, LayeredImage* film) {
  const auto channel = [&](std::string_view name) { return film->Get(layers::OfLevel(kMirror, name)); };
  const float a = SeenInMirror(x) * (*noise)();
  const float b = SeenInMirror(x) * (*noise)();
  NoisyLayer(layers::OfLevel(kMirror, layers::kDirect), film).Set(x, y, a, b);
  NoisyLayer(std::string(layers::kNoisy), film).Add(x, y, kReflectance * a, kReflectance * b);
  Set(film->GetColor(layers::OfLevel(kMirror, layers::kAlbedo)), x, y, kReflectance);
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB, layers::kMask})
    channel(name).At(x, y) = 1;
  channel(x < 48 ? layers::kNormalX : layers::kNormalY).At(x, y) = 1;
  channel(layers::kDistance).At(x, y) = x < 48 ? 4.0f : 6.0f;
  film->Get(layers::kMask).At(x, y) = 0;
}

LayeredImage MirrorFilm() {
  LayeredImage film = WallFilm();
  AddHalved(layers::OfLevel(kMirror, layers::kDirect), &film);
  AddHalved(layers::OfLevel(kMirror, layers::kIndirect), &film);
  for (const std::string_view layer : layers::kLevelWhole) film.AddColor(layers::OfLevel(kMirror, layer));
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB})
    film.Add(layers::OfLevel(kMirror, name));
  for (const std::string& name : layers::LevelFeatureChannels(kMirror)) film.Add(name);
  Noise noise;
  for (int y = kMirrorRect.y0; y < kMirrorRect.y1; ++y) {
    for (int x = kMirrorRect.x0; x < kMirrorRect.x1; ++x) AddMirrorPixel(x, y, &noise, &film);
  }
  return film;
}

double MirrorError(const ConstFloatView& picture) {
  double sum = 0;
  for (int y = kMirrorRect.y0; y < kMirrorRect.y1; ++y) {
    for (int x = kMirrorRect.x0; x < kMirrorRect.x1; ++x) {
      const double off = static_cast<double>(picture.At(x, y) - kReflectance * SeenInMirror(x));
      sum += off * off;
    }
  }
  return sum / (kMirrorRect.width() * kMirrorRect.height());
}

TEST(Reflections, AreFilteredByWhatTheyShow) {
  const LayeredImage film = MirrorFilm();
  const auto picture = Filtered(film, nullptr);
  const double noisy = MirrorError(film.GetColor(layers::kNoisy)[1]);
  EXPECT_LT(MirrorError(picture[1].view()), 0.05 * noisy);
  // The edge between the two surfaces in the mirror stays where it is.
  for (int y = 24; y < 40; ++y) EXPECT_GT(picture[1].At(46, y) - picture[1].At(49, y), 0.4f) << y;
}

TEST(Reflections, LeaveNoTraceAround) {
  const auto picture = Filtered(MirrorFilm(), nullptr);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      if (kMirrorRect.Contains(x, y)) continue;
      ASSERT_EQ(picture[0].At(x, y), 0) << x << " " << y;
    }
  }
}

// A white, lit surface before a dark, shaded one: the edge runs through the middle of column 48. The mean of
// the products is 0.505, the product of the means 0.3025.

constexpr int kEdgeColumn = 48;
constexpr float kLight[2] = {1.0f, 0.1f};  // left, right
constexpr float kAlbedo[2] = {1.0f, 0.1f};

void SetSide(const FloatView (&normal)[2], const FloatView& distance, int x, int y, int side) {
  normal[side].At(x, y) = 1;
  distance.At(x, y) = side == 0 ? 2.0f : 3.0f;
}

LayeredImage EdgeFilm() {
  LayeredImage film = WallFilm();
  for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(layers::kNormalZ).Row(y), kWidth, 0.0f);
  const FloatView normal[2] = {film.Get(layers::kNormalX), film.Get(layers::kNormalY)};
  Noise noise;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      // What part of each half's samples falls on the right surface: the coverage is noisy, too.
      float right[2] = {x > kEdgeColumn ? 1.0f : 0.0f, x > kEdgeColumn ? 1.0f : 0.0f};
      if (x == kEdgeColumn) right[0] = 0.25f + 0.5f * static_cast<float>(y % 2), right[1] = 1 - right[0];
      float light[2], radiance[2];
      for (int half = 0; half < 2; ++half) {
        const float left = kLight[0] * noise() * (1 - right[half]);
        const float far = kLight[1] * noise() * right[half];
        light[half] = left + far;
        radiance[half] = left * kAlbedo[0] + far * kAlbedo[1];
      }
      NoisyLayer(std::string(layers::kDirect), &film).Set(x, y, light[0], light[1]);
      NoisyLayer(std::string(layers::kNoisy), &film).Set(x, y, radiance[0], radiance[1]);
      const float share = 0.5f * (right[0] + right[1]);
      Set(film.GetColor(layers::kAlbedo), x, y, kAlbedo[0] + share * (kAlbedo[1] - kAlbedo[0]));
      SetSide(normal, film.Get(layers::kDistance), x, y, x > kEdgeColumn ? 1 : 0);
    }
  }
  return film;
}

LayeredImage EdgeSet() {
  LayeredImage edges(kSubSamples, kHeight);
  for (const std::string& name : layers::EdgeChannels()) edges.Add(name);
  const FloatView normal[2] = {edges.Get(layers::kNormalX), edges.Get(layers::kNormalY)};
  for (int y = 0; y < kHeight; ++y) {
    for (int j = 0; j < kSubSamples; ++j) {
      const int side = j % 4 < 2 ? 0 : 1;
      edges.Get(layers::kPixelX).At(j, y) = kEdgeColumn;
      edges.Get(layers::kPixelY).At(j, y) = static_cast<float>(y);
      SetSide(normal, edges.Get(layers::kDistance), j, y, side);
      edges.Get(layers::kMask).At(j, y) = 1;
      edges.Get(layers::kObjectId).At(j, y) = static_cast<float>(side + 1);
      Set(edges.GetColor(layers::kAlbedo), j, y, kAlbedo[side]);
    }
  }
  return edges;
}

TEST(EdgeAntialiasing, TakesTheMeanOfTheProducts) {
  const LayeredImage film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const auto with = Filtered(film, &edges);
  double mean = 0;
  for (int y = 0; y < kHeight; ++y) mean += static_cast<double>(with[0].At(kEdgeColumn, y)) / kHeight;
  EXPECT_NEAR(mean, 0.505, 0.03);  // the noise of 64 pixels leaves 0.01
}

TEST(DenoiseParts, WithoutEdgePointsOrLevelsThereIsMoreError) {
  const LayeredImage edge_film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const auto without_points = Denoise(edge_film, &edges, nullptr, {.edge_points = false});
  const auto without_edges = Filtered(edge_film, nullptr);
  for (int y = 0; y < kHeight; ++y)
    EXPECT_EQ(without_points[0].At(kEdgeColumn, y), without_edges[0].At(kEdgeColumn, y)) << y;
  const LayeredImage mirror_film = MirrorFilm();
  const auto without_levels = Denoise(mirror_film, nullptr, nullptr, {.levels = false});
  EXPECT_GT(MirrorError(without_levels[1].view()),
            1.5 * MirrorError(Filtered(mirror_film, nullptr)[1].view()));
}

TEST(EdgeAntialiasing, IsTheSameForAnyPool) {
  const LayeredImage film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const auto alone = Filtered(film, &edges);
  ShufflingPool pool(3);
  const auto shuffled = Filtered(film, &edges, &pool);
  for (int y = 0; y < kHeight; ++y)
    EXPECT_TRUE(std::equal(alone[1].Row(y), alone[1].Row(y) + kWidth, shuffled[1].Row(y))) << y;
}

TEST(EdgeAntialiasing, LeavesPixelsAloneWhoseSubSamplesShowAMirror) {
  const LayeredImage film = EdgeFilm();
  LayeredImage edges = EdgeSet();
  for (int y = 0; y < kHeight; ++y) edges.Get(layers::kMask).At(5, y) = 0;  // hit, not diffuse, not radiating
  const auto with = Filtered(film, &edges);
  const auto without = Filtered(film, nullptr);
  for (int y = 0; y < kHeight; ++y) EXPECT_EQ(with[0].At(kEdgeColumn, y), without[0].At(kEdgeColumn, y)) << y;
}

}  // namespace
}  // namespace lumifold::filter
