#include "filter/edges/relighting.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::filter {
namespace {

constexpr int kWidth = 24;
constexpr int kHeight = 40;
constexpr int kColumn = 12;                // of the pixels that show both surfaces
constexpr float kLight[2] = {0.8f, 0.2f};  // left, right; both white
constexpr float kMaxGlossyAlbedo = 0.12f;

/// What part of the pixel shows the surface to the right.
float RightPart(int y) { return static_cast<float>(1 + y % 3) / 4; }

float Truth(int x, int y) {
  const float right = x == kColumn ? RightPart(y) : (x > kColumn ? 1.0f : 0.0f);
  return kLight[0] + right * (kLight[1] - kLight[0]);
}

/// By how much the coverage that the samples of half A saw is off; half B's is off the other way but for a
/// half of it, so that their mean is off, too.
float Off(int y) { return y % 2 == 0 ? 0.24f : -0.24f; }

void Fill(const ColorView& color, int x, int y, float value) {
  for (const FloatView& channel : color) channel.At(x, y) = value;
}

/// Two surfaces before each other, their light without noise; how much of each a pixel of the column shows is
/// noisy in C.
EdgedImage TwoSurfaces() {
  EdgedImage film = {LayeredImage(kWidth, kHeight), LayeredImage(kSubSamples, kHeight)};
  for (const std::string& layer :
       {std::string(layers::kNoisy), layers::HalfA(layers::kNoisy), layers::HalfB(layers::kNoisy),
        std::string(layers::kAlbedo), std::string(layers::kEmission)})
    film.pixels.AddColor(layer);
  for (const std::string_view name : {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance,
                                      layers::kObjectId, layers::kMask, layers::kSamplesA, layers::kSamplesB})
    film.pixels.Add(name);
  for (const std::string& name : layers::EdgeChannels()) film.edges.Add(name);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const float off = x == kColumn ? Off(y) : 0.0f;
      Fill(film.pixels.GetColor(layers::HalfA(layers::kNoisy)), x, y, Truth(x, y) + off);
      Fill(film.pixels.GetColor(layers::HalfB(layers::kNoisy)), x, y, Truth(x, y) - off / 3);
      Fill(film.pixels.GetColor(layers::kNoisy), x, y, Truth(x, y) + off / 3);
      Fill(film.pixels.GetColor(layers::kAlbedo), x, y, 1);
      film.pixels.Get(layers::kNormalZ).At(x, y) = 1;
      film.pixels.Get(layers::kDistance).At(x, y) = x < kColumn ? 2.0f : 5.0f;
      film.pixels.Get(layers::kObjectId).At(x, y) = x < kColumn ? 1.0f : 2.0f;
      for (const std::string_view name : {layers::kMask, layers::kSamplesA, layers::kSamplesB})
        film.pixels.Get(name).At(x, y) = 1;
    }
    for (int j = 0; j < kSubSamples; ++j) {
      const bool is_right = static_cast<float>(j % 4) >= 4 - 4 * RightPart(y);
      film.edges.Get(layers::kPixelX).At(j, y) = kColumn;
      film.edges.Get(layers::kPixelY).At(j, y) = static_cast<float>(y);
      film.edges.Get(layers::kNormalZ).At(j, y) = 1;
      film.edges.Get(layers::kDistance).At(j, y) = is_right ? 5.0f : 2.0f;
      film.edges.Get(layers::kObjectId).At(j, y) = is_right ? 2.0f : 1.0f;
      film.edges.Get(layers::kMask).At(j, y) = 1;
      Fill(film.edges.GetColor(layers::kAlbedo), j, y, 1);
    }
  }
  return film;
}

std::array<Plane, 3> NoisyPicture(const LayeredImage& film) {
  std::array<Plane, 3> picture;
  for (size_t c = 0; c < 3; ++c) {
    picture[c] = Plane(kWidth, kHeight);
    CopyPlane(film.GetColor(layers::kNoisy)[c], picture[c].view());
  }
  return picture;
}

std::array<Plane, 3> Relit(const EdgedImage& film, TaskPool* pool = nullptr) {
  std::array<Plane, 3> picture = NoisyPicture(film.pixels);
  RelightEdges(Frame(film.pixels, &film.edges), kMaxGlossyAlbedo, pool, &picture);
  return picture;
}

double ColumnError(const std::array<Plane, 3>& picture) {
  double sum = 0;
  for (int y = 0; y < kHeight; ++y) {
    const double off = static_cast<double>(picture[1].At(kColumn, y) - Truth(kColumn, y));
    sum += off * off / kHeight;
  }
  return sum;
}

bool IsAsBefore(const EdgedImage& film, const std::array<Plane, 3>& picture) {
  const std::array<Plane, 3> before = NoisyPicture(film.pixels);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < kHeight; ++y) {
      if (!std::equal(before[c].Row(y), before[c].Row(y) + kWidth, picture[c].Row(y))) return false;
    }
  }
  return true;
}

TEST(RelightEdges, TakesOutTheNoiseOfTheCoverage) {
  const EdgedImage film = TwoSurfaces();
  const std::array<Plane, 3> relit = Relit(film);
  EXPECT_LT(ColumnError(relit), 0.1 * ColumnError(NoisyPicture(film.pixels)));
  for (int y = 0; y < kHeight; ++y) {
    EXPECT_EQ(relit[0].At(kColumn - 1, y), Truth(kColumn - 1, y)) << y;
    EXPECT_EQ(relit[0].At(kColumn + 1, y), Truth(kColumn + 1, y)) << y;
  }
}

TEST(RelightEdges, FollowsCWhereTheSubSamplesAreWrong) {
  EdgedImage film = TwoSurfaces();
  for (int y = 0; y < kHeight; ++y) {  // a thin, bright thing that they miss
    for (const std::string& layer :
         {std::string(layers::kNoisy), layers::HalfA(layers::kNoisy), layers::HalfB(layers::kNoisy)}) {
      const float brighter = film.pixels.GetColor(layer)[0].At(kColumn, y) + 3.0f;
      Fill(film.pixels.GetColor(layer), kColumn, y, brighter);
    }
  }
  const std::array<Plane, 3> relit = Relit(film);
  for (int y = 0; y < kHeight; ++y) EXPECT_NEAR(relit[1].At(kColumn, y), Truth(kColumn, y) + 3, 0.2f) << y;
}

/// The left surface before the sky; a tenth of each pixel of the column shows it, which all sub-samples miss.
EdgedImage SliceBeforeSky() {
  EdgedImage film = TwoSurfaces();
  constexpr float kPart = 0.1f;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = kColumn; x < kWidth; ++x) {
      const float part = x == kColumn ? kPart : 0.0f;
      const float truth = part * kLight[0];
      for (const std::string_view name : {layers::kDistance, layers::kObjectId, layers::kMask})
        film.pixels.Get(name).At(x, y) = 0;
      Fill(film.pixels.GetColor(layers::kAlbedo), x, y, part);
      Fill(film.pixels.GetColor(layers::HalfA(layers::kNoisy)), x, y, truth * (1 + 4 * Off(y)));
      Fill(film.pixels.GetColor(layers::HalfB(layers::kNoisy)), x, y, truth * (1 - 2 * Off(y)));
      Fill(film.pixels.GetColor(layers::kNoisy), x, y, truth * (1 + Off(y)));
    }
    for (int j = 0; j < kSubSamples; ++j) {
      for (const std::string_view name : {layers::kDistance, layers::kObjectId, layers::kMask})
        film.edges.Get(name).At(j, y) = 0;
      Fill(film.edges.GetColor(layers::kAlbedo), j, y, 0);
    }
  }
  return film;
}

TEST(RelightEdges, LightsSlicesThatSubSamplesMissAsWhatIsBesideThem) {
  const EdgedImage film = SliceBeforeSky();
  const std::array<Plane, 3> relit = Relit(film);
  for (int y = 0; y < kHeight; ++y) {
    EXPECT_NEAR(relit[1].At(kColumn, y), 0.1f * kLight[0], 0.004f) << y;  // C is off by .019
    EXPECT_EQ(relit[1].At(kColumn + 1, y), 0) << y;
  }
}

TEST(RelightEdges, LeavesAloneWhatTheSubSamplesDoNotTell) {
  EdgedImage mirror = TwoSurfaces();
  for (int y = 0; y < kHeight; ++y)
    mirror.edges.Get(layers::kMask).At(3, y) = 0;  // hit, neither lit nor a lamp
  EXPECT_TRUE(IsAsBefore(mirror, Relit(mirror)));
  EdgedImage glossy = TwoSurfaces();
  const ColorView specular = glossy.pixels.AddColor(layers::kGlossyAlbedo);
  for (int y = 0; y < kHeight; ++y) Fill(specular, kColumn, y, 0.5f);
  EXPECT_TRUE(IsAsBefore(glossy, Relit(glossy)));
  EdgedImage one_half = TwoSurfaces();
  for (int y = 0; y < kHeight; ++y) std::fill_n(one_half.pixels.Get(layers::kSamplesB).Row(y), kWidth, 0.0f);
  EXPECT_TRUE(IsAsBefore(one_half, Relit(one_half)));
}

TEST(RelightEdges, StaysFiniteAndIsTheSameForAnyPool) {
  EdgedImage film = TwoSurfaces();
  const std::array<Plane, 3> alone = Relit(film);
  ShufflingPool pool(3);
  const std::array<Plane, 3> shuffled = Relit(film, &pool);
  for (int y = 0; y < kHeight; ++y)
    EXPECT_TRUE(std::equal(alone[1].Row(y), alone[1].Row(y) + kWidth, shuffled[1].Row(y))) << y;
  Fill(film.pixels.GetColor(layers::HalfA(layers::kNoisy)), kColumn, 7,
       std::numeric_limits<float>::infinity());
  Fill(film.pixels.GetColor(layers::kAlbedo), kColumn + 1, 20, std::numeric_limits<float>::quiet_NaN());
  const std::array<Plane, 3> odd = Relit(film);
  for (int y = 0; y < kHeight; ++y) EXPECT_TRUE(std::isfinite(odd[1].At(kColumn, y))) << y;
}

}  // namespace
}  // namespace lumifold::filter
