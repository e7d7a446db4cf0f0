#include "filter/edges/regression.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "filter/denoise/frame_halves.h"
#include "filter/layers/mixed_pixels.h"
#include "tests/unit/filter/are_equal.h"
#include "tests/unit/filter/edge_films.h"
#include "tests/unit/filter/manifold_oracle.h"
#include "tests/unit/filter/synthetic_film.h"

namespace lumifold::filter {
namespace {

constexpr float kMixedKnee = 0.2f;

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

/// F = `picture` in both halves, as a change of the halves of C.
FrameChange ChangeTo(const Picture& picture, const Frame& frame) {
  FrameChange change = NoChange(frame);
  for (size_t h = 0; h < 2; ++h) {
    const ConstColorView& half = h == 0 ? frame.combined.a : frame.combined.b;
    for (size_t c = 0; c < 3; ++c) {
      ForEachPixel(frame.width, frame.height, [&](int x, int y) {
        change[h][c].At(x, y) = UsableOr0(picture[c].At(x, y)) - UsableOr0(half[c].At(x, y));
      });
    }
  }
  return change;
}

/// The mean of the halves after a change.
Picture MeanAfter(const FrameChange& change, const Frame& frame) {
  Picture picture;
  for (size_t c = 0; c < 3; ++c) {
    picture[c] = Plane(frame.width, frame.height);
    ForEachPixel(frame.width, frame.height, [&](int x, int y) {
      const float a = UsableOr0(frame.combined.a[c].At(x, y)) + change[0][c].At(x, y);
      const float b = UsableOr0(frame.combined.b[c].At(x, y)) + change[1][c].At(x, y);
      picture[c].At(x, y) = 0.5f * (a + b);
    });
  }
  return picture;
}

/// F + the fit of C - F, and the fit of C.
std::array<Picture, 2> FitsOf(const Frame& frame, const Picture& picture) {
  const std::vector<FrameChange> fits = FitMixedPixels(frame, MixedPixelsOf(frame, 0.5f),
                                                       ChangeTo(picture, frame), {}, kMixedKnee, {}, nullptr);
  EXPECT_EQ(fits.size(), 2u);
  return {MeanAfter(fits[0], frame), MeanAfter(fits[1], frame)};
}

/// Moves F towards the fits as far as the halves of C show that it lowers the error.
void Regress(const Frame& frame, Picture* picture) {
  const Plane mixed = MixedPixelsOf(frame, 0.5f);
  FrameChange change = ChangeTo(*picture, frame);
  ChooseChange(frame, mixed, FitMixedPixels(frame, mixed, change, {}, kMixedKnee, {}, nullptr), {}, nullptr,
               &change);
  *picture = MeanAfter(change, frame);
}

double MeanAtEdge(const std::array<Plane, 3>& picture) {
  double mean = 0;
  for (int y = 0; y < kHeight; ++y) mean += static_cast<double>(picture[0].At(kEdgeColumn, y)) / kHeight;
  return mean;
}

TEST(EdgeRegression, TakesOutABiasOfEdgesAndLeavesTheRest) {
  const LayeredImage film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const std::array<Picture, 2> fits = FitsOf(Frame(film, &edges), PictureWithEdge(1.4f));  // C is about 0.5
  for (const Picture& fit : fits) {
    EXPECT_NEAR(MeanAtEdge(fit), 0.505, 0.1);
    for (const int side : {0, 1}) {
      const float truth = kLight[side] * kAlbedo[side];
      EXPECT_NEAR(fit[0].At(kEdgeColumn + 2 * (2 * side - 1), 9), truth, 1e-5f);
    }
  }
}

TEST(EdgeRegression, EqualsItsOracleInAnyMemoryOfADevice) {
  const LayeredImage film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const Frame frame(film, &edges);
  const auto fit = [&](TaskPool* pool) {
    return FitMixedPixels(frame, MixedPixelsOf(frame, 0.5f), ChangeTo(PictureWithEdge(1.4f), frame), {},
                          kMixedKnee, {}, pool);
  };
  const std::vector<FrameChange> here = fit(nullptr);
  for (const bool is_small : {false, true}) {
    const std::vector<FrameChange> oracle = fit(PoolWithOracle(is_small).get());
    for (size_t i = 0; i < here.size(); ++i) {
      for (const size_t h : {0, 1}) EXPECT_TRUE(AreEqual(here[i][h], oracle[i][h]));
    }
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
  Regress(Frame(film, &edges), &picture);
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
  Regress(Frame(film), &picture);
  return picture[0].At(kX, kY) - 0.5f;
}

TEST(EdgeRegression, TakesOutABiasInMirrorsButFollowsNoSingleSample) {
  EXPECT_NEAR(ChangeInMirror(0.2f, 0), 0.2f, 0.04f);
  EXPECT_NEAR(ChangeInMirror(0, 0), 0, 0.01f);
  EXPECT_NEAR(ChangeInMirror(0, 20), 0, 0.05f);
}

TEST(EdgeRegression, FitsMetalsOffTheEdgeSetToo) {
  for (const float specular : {0.04f, 0.9f}) {
    LayeredImage film = EdgeFilm();
    film.AddColor(layers::kGlossyAlbedo);
    for (int y = 0; y < kHeight; ++y) Set(film.GetColor(layers::kGlossyAlbedo), kEdgeColumn, y, specular);
    const std::array<Picture, 2> fits = FitsOf(Frame(film), PictureWithEdge(1.4f));
    EXPECT_NEAR(MeanAtEdge(fits[0]), specular < 0.5f ? 1.4 : 0.505, specular < 0.5f ? 1e-6 : 0.2);
  }
}

/// EdgeFilm() as of another renderer, which has T in halves.
LayeredImage ForeignEdgeFilm() {
  LayeredImage film = EdgeFilm();
  for (const std::string& half : {layers::HalfA(layers::kAlbedo), layers::HalfB(layers::kAlbedo)}) {
    const ColorView out = film.AddColor(half);
    for (size_t c = 0; c < 3; ++c) CopyPlane(std::as_const(film).GetColor(layers::kAlbedo)[c], out[c]);
  }
  return film;
}

TEST(EdgeRegression, FindsEdgesOfOtherRenderersByNormalAndDistance) {
  const LayeredImage film = ForeignEdgeFilm();
  for (const Picture& fit : FitsOf(Frame(film), PictureWithEdge(1.4f)))
    EXPECT_NEAR(MeanAtEdge(fit), 0.505, 0.1);
}

TEST(EdgeRegression, DoesNothingWithoutASecondHalf) {
  LayeredImage film = EdgeFilm();
  for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(layers::kSamplesB).Row(y), kWidth, 0.0f);
  const LayeredImage edges = EdgeSet();
  const Frame frame(film, &edges);
  const FrameChange change = ChangeTo(PictureWithEdge(1.4f), frame);
  for (const FrameChange& fit :
       FitMixedPixels(frame, MixedPixelsOf(frame, 0.5f), change, {}, kMixedKnee, {}, nullptr)) {
    for (int y = 0; y < kHeight; ++y)
      EXPECT_EQ(fit[0][0].At(kEdgeColumn, y), change[0][0].At(kEdgeColumn, y));
  }
}

TEST(EdgeRegression, ScalesWithTheUnitOfLightAndStaysFinite) {
  const LayeredImage edges = EdgeSet();
  std::array<Plane, 3> plain = PictureWithEdge(1.4f);
  Regress(Frame(EdgeFilm(), &edges), &plain);
  for (const float factor : {1e-20f, 1e20f}) {
    LayeredImage film = EdgeFilm();
    std::array<Plane, 3> picture = PictureWithEdge(1.4f);
    for (Plane& plane : picture) {
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) plane.At(x, y) *= factor;
      }
    }
    ScaleRadiance(factor, &film);
    Regress(Frame(film, &edges), &picture);
    for (int y = 0; y < kHeight; ++y)
      EXPECT_NEAR(picture[0].At(kEdgeColumn, y) / factor, plain[0].At(kEdgeColumn, y), 1e-4f) << y;
    film.GetColor(layers::HalfA(layers::kNoisy))[0].At(kEdgeColumn, 20) = NAN;
    film.Get(layers::kNormalX).At(kEdgeColumn + 1, 30) = INFINITY;
    Regress(Frame(film, &edges), &picture);
    for (int y = 0; y < kHeight; ++y) EXPECT_TRUE(std::isfinite(picture[0].At(kEdgeColumn, y))) << y;
  }
}

}  // namespace
}  // namespace lumifold::filter
