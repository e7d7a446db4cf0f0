#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "filter/denoise/denoise.h"
#include "filter/edges/antialiasing.h"
#include "filter/edges/coverage_means.h"
#include "filter/edges/regression.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/methods.h"
#include "tests/support/shuffling_pool.h"
#include "tests/unit/filter/synthetic_film.h"

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
  explicit Noise(uint32_t seed = 11) : random_(seed) {}
  float operator()() {
    return std::gamma_distribution<float>(1 / (kNoise * kNoise), kNoise * kNoise)(random_);
  }

 private:
  std::mt19937 random_;
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

LayeredImage EdgeFilm(uint32_t seed = 11) {
  LayeredImage film = WallFilm();
  for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(layers::kNormalZ).Row(y), kWidth, 0.0f);
  const FloatView normal[2] = {film.Get(layers::kNormalX), film.Get(layers::kNormalY)};
  Noise noise(seed);
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
    for (const FloatView& side : normal) side.At(kEdgeColumn, y) = 0.5f;  // means over the sub-samples
    film.Get(layers::kDistance).At(kEdgeColumn, y) = 2.5f;
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

TEST(EdgeAntialiasing, LeavesPixelsAloneThatNothingHits) {
  const LayeredImage film = EdgeFilm();
  LayeredImage edges = EdgeSet();
  const FloatView ids = edges.Get(layers::kObjectId);
  for (int y = 0; y < kHeight; ++y) std::fill_n(ids.Row(y), kSubSamples, 0.0f);
  const auto with = Filtered(film, &edges);
  const auto without = Filtered(film, nullptr);
  for (int y = 0; y < kHeight; ++y) EXPECT_EQ(with[0].At(kEdgeColumn, y), without[0].At(kEdgeColumn, y)) << y;
}

TEST(EdgeAntialiasing, TakesTheMeanOfTheProducts) {
  const LayeredImage edges = EdgeSet();
  constexpr int kFilms = 6;
  double mean = 0;
  for (uint32_t seed = 1; seed <= kFilms; ++seed) {
    const auto with = Filtered(EdgeFilm(seed), &edges);
    for (int y = 0; y < kHeight; ++y)
      mean += static_cast<double>(with[0].At(kEdgeColumn, y)) / (kHeight * kFilms);
  }
  EXPECT_NEAR(mean, 0.505, 0.045);  // three deviations of C in so many pixels
}

TEST(Stages, WithoutEdgesOrLevelsThereIsMoreError) {
  const LayeredImage edge_film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const auto without_stages = Denoise(edge_film, &edges, nullptr, {.off = {"antialiasing", "coverage", "relighting", "regression"}, .watch = {}});
  const auto without_edges = Filtered(edge_film, nullptr);
  for (int y = 0; y < kHeight; ++y)
    EXPECT_EQ(without_stages[0].At(kEdgeColumn, y), without_edges[0].At(kEdgeColumn, y)) << y;
  const LayeredImage mirror_film = MirrorFilm();
  const auto without_levels = Denoise(mirror_film, nullptr, nullptr, {.off = {"levels"}, .watch = {}});
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

TEST(EdgeAntialiasing, ReadsNoLightWhereASubSampleShowsAMirror) {
  const LayeredImage film = EdgeFilm();
  LayeredImage edges = EdgeSet();
  for (int y = 1; y < kHeight; ++y) edges.Get(layers::kMask).At(5, y) = 0;  // hit, not diffuse, not radiating
  EXPECT_EQ(EdgePointsOf(Frame(film, &edges), 1.0f, std::numeric_limits<float>::infinity(), kSigmaNormal).rows,
            std::vector<int>{0});
}

// A lamp of radiance 8 that covers half of an edge pixel, which few samples hit by chance.

TEST(CoverageChange, TakeOutTheNoiseOfWhereFewSamplesFell) {
  LayeredImage film = WallFilm();  // two samples a pixel
  LayeredImage edges = EdgeSet();
  Set(film.GetColor(layers::kEmission), kEdgeColumn, 5, 8.0f);  // both hit
  Set(film.GetColor(layers::kAlbedo), kEdgeColumn, 5, 0.0f);
  for (int j = 0; j < kSubSamples; ++j) {
    const bool is_lamp = j % 4 < 2;
    Set(edges.GetColor(layers::kEmission), j, 5, is_lamp ? 8.0f : 0.0f);
    Set(edges.GetColor(layers::kAlbedo), j, 5, is_lamp ? 0.0f : 0.6f);
  }
  Planes light = MakePlanes(3, kWidth, kHeight);
  for (Plane& plane : light) plane.Fill(1.5f);
  const Planes change = CoverageChange(Frame(film, &edges), light, nullptr);
  // Two samples beside 256 / 2 that say nothing, and no other pixel alike; then own ones once more.
  const float share = (1 - 2.0f / (2.0f + 128.0f)) * (1 - 4.0f / (4.0f + 1024.0f));
  EXPECT_NEAR(change[1].At(kEdgeColumn, 5), share * ((4.0f - 8.0f) + 1.5f * 0.3f), 1e-5f);
  EXPECT_EQ(change[1].At(kEdgeColumn + 1, 5), 0);

  for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB})
    film.Get(count).At(kEdgeColumn, 5) = 2048;
  EXPECT_NEAR(CoverageChange(Frame(film, &edges), light, nullptr)[1].At(kEdgeColumn, 5), 0, 1e-4f);
  EXPECT_EQ(CoverageChange(Frame(film, nullptr), light, nullptr)[1].At(kEdgeColumn, 5), 0);
}

// A lamp of radiance 8 left of the edge, which covers a twentieth of the pixels there: so little that all
// sub-samples miss it, and of 16 samples four fall on it in every fifth pixel.

TEST(CoverageChange, FindWhatSubSamplesMissByThePixelsAlike) {
  LayeredImage film = WallFilm();
  LayeredImage edges = EdgeSet();
  const ColorView emission = film.GetColor(layers::kEmission);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kEdgeColumn; ++x) Set(emission, x, y, 8.0f);
    Set(emission, kEdgeColumn, y, y % 5 == 0 ? 2.0f : 0.0f);
    for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB})
      film.Get(count).At(kEdgeColumn, y) = 8;
    for (int j = 0; j < kSubSamples; ++j) Set(edges.GetColor(layers::kAlbedo), j, y, 0.0f);
  }
  const Planes none = MakePlanes(3, kWidth, kHeight);
  const Planes change = CoverageChange(Frame(film, &edges), none, nullptr);
  for (int y = 16; y < kHeight - 16; ++y) {
    const float steady = emission[1].At(kEdgeColumn, y) + change[1].At(kEdgeColumn, y);
    EXPECT_GT(steady, 0.25f) << y;  // of .4; without the pixels alike: 0 or 1
    EXPECT_LT(steady, 0.8f) << y;
  }
}

/// A film whose pixels in `where` show a mirror.
LayeredImage ShowingMirror(LayeredImage film, const Rect& where) {
  const FloatView distance = film.Add(layers::OfLevel(kMirror, layers::kDistance));
  for (int y = where.y0; y < where.y1; ++y) {
    for (int x = where.x0; x < where.x1; ++x) distance.At(x, y) = 4;
  }
  return film;
}

TEST(CoverageChange, LeaveTWhereAMirrorTakesPartOfThePixel) {
  constexpr Rect kMirrored = {kEdgeColumn, 0, kEdgeColumn + 1, 6};
  const LayeredImage film = ShowingMirror(WallFilm(), kMirrored);
  LayeredImage edges = EdgeSet();
  for (const int row : {5, 6}) {
    for (int j = 0; j < kSubSamples; ++j) {
      Set(edges.GetColor(layers::kAlbedo), j, row, 0.6f);
      Set(edges.GetColor(layers::kEmission), j, row, 0.0f);
    }
  }
  Planes light = MakePlanes(3, kWidth, kHeight);
  for (Plane& plane : light) plane.Fill(1.5f);
  const Planes change = CoverageChange(Frame(film, &edges), light, nullptr);
  EXPECT_EQ(change[1].At(kEdgeColumn, 5), 0);
  EXPECT_GT(change[1].At(kEdgeColumn, 6), 0.8f);  // .6 of 1.5, which the own samples did not see
}

/// The truth on both sides, `at_edge` between them.
std::array<Plane, 3> PictureWithEdge(float at_edge) {
  std::array<Plane, 3> picture;
  for (size_t c = 0; c < 3; ++c) {
    picture[c] = Plane(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const int side = x > kEdgeColumn ? 1 : 0;
        picture[c].At(x, y) = x == kEdgeColumn ? at_edge : kLight[side] * kAlbedo[side];
      }
    }
  }
  return picture;
}

double MeanAtEdge(const std::array<Plane, 3>& picture) {
  double mean = 0;
  for (int y = 0; y < kHeight; ++y) mean += static_cast<double>(picture[0].At(kEdgeColumn, y)) / kHeight;
  return mean;
}

TEST(EdgeRegression, TakesOutABiasOfEdgesAndLeavesTheRest) {
  LayeredImage film = EdgeFilm();
  for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB})
    for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(count).Row(y), kWidth, 32.0f);
  const LayeredImage edges = EdgeSet();
  const Planes none = MakePlanes(3, kWidth, kHeight);
  std::array<Plane, 3> biased = PictureWithEdge(1.4f);  // C is about 0.5 there
  RegressEdges(Frame(film, &edges), none, nullptr, &biased);
  EXPECT_LT(MeanAtEdge(biased), 0.6);
  for (const int side : {0, 1}) {
    const int outwards = 2 * side - 1;
    const float truth = kLight[side] * kAlbedo[side];
    EXPECT_NEAR(biased[0].At(kEdgeColumn + outwards, 9), truth, 0.1f * truth);
    EXPECT_EQ(biased[0].At(kEdgeColumn + 2 * outwards, 9), truth);
  }
}

constexpr Rect kPatch = {30, 20, 60, 44};  // of pixels on edges

/// The edge set of kPatch: all that is told of it is that its pixels are on edges.
LayeredImage PatchOfEdges() {
  LayeredImage edges(kSubSamples, kPatch.width() * kPatch.height());
  for (const std::string& name : layers::EdgeChannels()) edges.Add(name);
  for (int row = 0; row < edges.height(); ++row) {
    const int x = kPatch.x0 + row % kPatch.width();
    const int y = kPatch.y0 + row / kPatch.width();
    for (int j = 0; j < kSubSamples; ++j) {
      edges.Get(layers::kPixelX).At(j, row) = static_cast<float>(x);
      edges.Get(layers::kPixelY).At(j, row) = static_cast<float>(y);
      edges.Get(layers::kObjectId).At(j, row) = 1;
    }
  }
  return edges;
}

/// One of two numbers, without any order from pixel to pixel.
int SideOf(int x, int y) { return (x * 7 + y * 13 + x * y) / 4 % 2; }

/// RMS error in kPatch after the regression of F = 0.5. The truth is 0.5 and `off` more on one side, less on
/// the other; `side_channel` is `mean` and half of that more or less; the halves have deviation `noise`.
double ErrorAfterRegression(std::string_view side_channel, float mean, float off, float noise) {
  LayeredImage film = WallFilm();
  film.AddColor(layers::kGlossyAlbedo);
  film.Add(layers::kRoughness);
  std::mt19937 random(5);
  std::normal_distribution<float> normal;
  const NoisyLayer noisy(std::string(layers::kNoisy), &film);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const auto sign = static_cast<float>(2 * SideOf(x, y) - 1);
      const float truth = 0.5f + sign * off;
      noisy.Set(x, y, truth + noise * normal(random), truth + noise * normal(random));
      if (film.HasColor(side_channel)) Set(film.GetColor(side_channel), x, y, mean * (1 + 0.5f * sign));
      if (film.Has(side_channel)) film.Get(side_channel).At(x, y) = mean * (1 + 0.5f * sign);
    }
  }
  const LayeredImage edges = PatchOfEdges();
  std::array<Plane, 3> picture;
  for (Plane& plane : picture) {
    plane = Plane(kWidth, kHeight);
    plane.Fill(0.5f);
  }
  RegressEdges(Frame(film, &edges), MakePlanes(3, kWidth, kHeight), nullptr, &picture);
  double square = 0;
  for (int y = kPatch.y0; y < kPatch.y1; ++y) {
    for (int x = kPatch.x0; x < kPatch.x1; ++x) {
      const float truth = 0.5f + static_cast<float>(2 * SideOf(x, y) - 1) * off;
      square += std::pow(static_cast<double>(picture[0].At(x, y) - truth), 2);
    }
  }
  return std::sqrt(square / (kPatch.width() * kPatch.height()));
}

TEST(EdgeRegression, TellsSurfacesApartByEachOfItsTerms) {
  for (const std::string_view channel : {layers::kAlbedo, layers::kNormalX, layers::kMask,
                                         layers::kGlossyAlbedo, layers::kDistance, layers::kRoughness})
    EXPECT_LT(ErrorAfterRegression(channel, 0.5f, 0.1f, 0.01f), 0.02) << channel;
}

TEST(EdgeRegression, AddsLittleNoiseWhereThereIsNothingToCorrect) {
  constexpr float kDeviation = 0.5f;
  EXPECT_LT(ErrorAfterRegression(layers::kAlbedo, 0.5f, 0, kDeviation), 0.025);
}

/// What the regression adds to F = 0.5 at the pixel in the midst of kPatch, all of which shows a mirror: of
/// C = 0.5 + `off`, one of whose halves is `firefly` brighter two pixels beside it.
float ChangeInMirror(float off, float firefly) {
  LayeredImage film = ShowingMirror(WallFilm(), kPatch);
  for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB})
    for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(count).Row(y), kWidth, 32.0f);
  std::mt19937 random(5);
  std::normal_distribution<float> normal(0.5f + off, 0.02f);
  const NoisyLayer noisy(std::string(layers::kNoisy), &film);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const float a = normal(random);
      noisy.Set(x, y, a, normal(random));
    }
  }
  constexpr int kX = (kPatch.x0 + kPatch.x1) / 2;
  constexpr int kY = (kPatch.y0 + kPatch.y1) / 2;
  noisy.Set(kX + 2, kY, 0.5f + off + firefly, 0.5f + off);
  std::array<Plane, 3> picture;
  for (Plane& plane : picture) {
    plane = Plane(kWidth, kHeight);
    plane.Fill(0.5f);
  }
  RegressEdges(Frame(film, nullptr), MakePlanes(3, kWidth, kHeight), nullptr, &picture);
  return picture[0].At(kX, kY) - 0.5f;
}

TEST(EdgeRegression, TakesOutABiasInMirrorsButFollowsNoSingleSample) {
  EXPECT_NEAR(ChangeInMirror(0.2f, 0), 0.2f, 0.04f);
  EXPECT_NEAR(ChangeInMirror(0, 0), 0, 0.01f);
  EXPECT_NEAR(ChangeInMirror(0, 20), 0, 0.05f);
}

TEST(EdgeRegression, BelievesTheFitsTheMoreOfMoreSamples) {
  const LayeredImage edges = EdgeSet();
  LayeredImage film = EdgeFilm();
  double before = 1.4;
  for (const float samples : {2.0f, 16.0f, 128.0f}) {
    for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB})
      for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(count).Row(y), kWidth, samples);
    std::array<Plane, 3> picture = PictureWithEdge(1.4f);
    RegressEdges(Frame(film, &edges), MakePlanes(3, kWidth, kHeight), nullptr, &picture);
    EXPECT_LT(MeanAtEdge(picture), before) << samples;
    before = MeanAtEdge(picture);
  }
}

TEST(EdgeRegression, FitsMetalsOffTheEdgeSetToo) {
  for (const float specular : {0.04f, 0.9f}) {
    LayeredImage film = EdgeFilm();
    film.AddColor(layers::kGlossyAlbedo);
    for (int y = 0; y < kHeight; ++y) Set(film.GetColor(layers::kGlossyAlbedo), kEdgeColumn, y, specular);
    std::array<Plane, 3> picture = PictureWithEdge(1.4f);
    RegressEdges(Frame(film, nullptr), MakePlanes(3, kWidth, kHeight), nullptr, &picture);
    if (specular < 0.5f) {
      EXPECT_EQ(picture[0].At(kEdgeColumn, 9), 1.4f);
    } else {
      EXPECT_LT(MeanAtEdge(picture), 1);
    }
  }
}

TEST(EdgeRegression, DoesNothingWithoutASecondHalf) {
  LayeredImage film = EdgeFilm();
  for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(layers::kSamplesB).Row(y), kWidth, 0.0f);
  const LayeredImage edges = EdgeSet();
  std::array<Plane, 3> picture = PictureWithEdge(1.4f);
  RegressEdges(Frame(film, &edges), MakePlanes(3, kWidth, kHeight), nullptr, &picture);
  for (int y = 0; y < kHeight; ++y) EXPECT_EQ(picture[0].At(kEdgeColumn, y), 1.4f) << y;
}

TEST(EdgeRegression, ScalesWithTheUnitOfLightAndStaysFinite) {
  const LayeredImage edges = EdgeSet();
  const Planes none = MakePlanes(3, kWidth, kHeight);
  std::array<Plane, 3> plain = PictureWithEdge(1.4f);
  RegressEdges(Frame(EdgeFilm(), &edges), none, nullptr, &plain);
  for (const float factor : {1e-20f, 1e20f}) {
    LayeredImage film = EdgeFilm();
    std::array<Plane, 3> picture = PictureWithEdge(1.4f);
    for (Plane& plane : picture) {
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) plane.At(x, y) *= factor;
      }
    }
    ScaleRadiance(factor, &film);
    RegressEdges(Frame(film, &edges), none, nullptr, &picture);
    for (int y = 0; y < kHeight; ++y)
      EXPECT_NEAR(picture[0].At(kEdgeColumn, y) / factor, plain[0].At(kEdgeColumn, y), 1e-4f) << y;
    film.GetColor(layers::HalfA(layers::kNoisy))[0].At(kEdgeColumn, 20) = NAN;
    film.Get(layers::kNormalX).At(kEdgeColumn + 1, 30) = INFINITY;
    RegressEdges(Frame(film, &edges), none, nullptr, &picture);
    for (int y = 0; y < kHeight; ++y) EXPECT_TRUE(std::isfinite(picture[0].At(kEdgeColumn, y))) << y;
  }
}

}  // namespace
}  // namespace lumifold::filter
