#include "filter/metrics/regions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/metrics/metrics.h"
#include "tests/unit/metrics/color_of.h"

namespace lumifold::metrics {
namespace {

constexpr int kSide = 32;

/// A plane that faces the camera, white and evenly lit.
EdgedImage EvenPlane() {
  EdgedImage film;
  film.pixels = LayeredImage(kSide, kSide);
  for (const std::string_view layer : {layers::kAlbedo, layers::kDirect}) {
    for (const FloatView& channel : film.pixels.AddColor(layer)) {
      ForEachPixel(kSide, kSide, [&](int x, int y) { channel.At(x, y) = 0.8f; });
    }
  }
  for (const std::string_view name :
       {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kObjectId})
    film.pixels.Add(name);
  ForEachPixel(kSide, kSide, [&](int x, int y) {
    film.pixels.Get(layers::kNormalZ).At(x, y) = 1;
    film.pixels.Get(layers::kObjectId).At(x, y) = 1;
  });
  return film;
}

Region At(const EdgedImage& film, int x, int y) {
  return RegionsOf(film)[static_cast<size_t>(y) * kSide + static_cast<size_t>(x)];
}

void Darken(EdgedImage* film, int first_x) {
  for (const FloatView& channel : film->pixels.GetColor(layers::kDirect)) {
    for (int y = 0; y < kSide; ++y) {
      for (int x = first_x; x < kSide; ++x) channel.At(x, y) = 0.1f;
    }
  }
}

TEST(Regions, OfAnEvenPlaneAreFlat) {
  for (const Region region : RegionsOf(EvenPlane())) EXPECT_EQ(region, Region::kFlat);
}

TEST(Regions, FindTheBandOfAShadow) {
  EdgedImage film = EvenPlane();
  Darken(&film, 16);
  EXPECT_EQ(At(film, 15, 10), Region::kShadow);
  EXPECT_EQ(At(film, 16, 10), Region::kShadow);
  EXPECT_EQ(At(film, 8, 10), Region::kFlat);
  EXPECT_EQ(At(film, 24, 10), Region::kFlat);
}

TEST(Regions, TakeNoStepBetweenTwoThingsForAShadow) {
  EdgedImage film = EvenPlane();
  Darken(&film, 16);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 16; x < kSide; ++x) film.pixels.Get(layers::kObjectId).At(x, y) = 2;
  }
  EXPECT_EQ(At(film, 15, 10), Region::kFlat);
  EXPECT_EQ(At(film, 16, 10), Region::kFlat);
}

TEST(Regions, TakeASlowRampForNoShadow) {
  EdgedImage film = EvenPlane();
  for (const FloatView& channel : film.pixels.GetColor(layers::kDirect)) {
    ForEachPixel(kSide, kSide,
                 [&](int x, int y) { channel.At(x, y) = 0.5f + 0.01f * static_cast<float>(x); });
  }
  EXPECT_EQ(At(film, 16, 10), Region::kFlat);
}

TEST(Regions, FindTexturesMirrorsAndEdgesInThatOrder) {
  EdgedImage film = EvenPlane();
  film.pixels.Get("albedo.R").At(5, 5) = 0.2f;
  EXPECT_EQ(At(film, 5, 5), Region::kTextured);
  film.pixels.Add(layers::OfLevel({layers::Branch::kReflection, 1}, layers::kDistance)).At(5, 5) = 3;
  EXPECT_EQ(At(film, 5, 5), Region::kMirror);
  film.edges = LayeredImage(kSubSamples, 1);
  for (const std::string_view name : {layers::kPixelX, layers::kPixelY}) {
    const FloatView place = film.edges.Add(name);
    for (int i = 0; i < kSubSamples; ++i) place.At(i, 0) = 5;
  }
  EXPECT_EQ(At(film, 5, 5), Region::kEdges);
}

/// A film with columns for rows.
EdgedImage Transposed(const EdgedImage& film) {
  EdgedImage turned;
  turned.pixels = LayeredImage(film.pixels.height(), film.pixels.width());
  for (const LayeredImage::Channel& channel : film.pixels.channels()) {
    const FloatView to = turned.pixels.Add(channel.name);
    const ConstFloatView from = film.pixels.Get(channel.name);
    ForEachPixel(from.width(), from.height(), [&](int x, int y) { to.At(y, x) = from.At(x, y); });
  }
  return turned;
}

TEST(Regions, AreTheSameAlongBothAxes) {
  constexpr int kWide = 40;
  constexpr int kHigh = 23;
  EdgedImage film;
  film.pixels = LayeredImage(kWide, kHigh);
  std::mt19937 random(3);
  const auto fill = [&](FloatView channel, float low, float high) {  // flat on patches of several sizes
    ForEachPixel(kWide, kHigh, [&](int x, int y) { channel.At(x, y) = low; });
    for (int i = 0; i < 12; ++i) {
      const int x0 = static_cast<int>(random() % kWide);
      const int y0 = static_cast<int>(random() % kHigh);
      const float value = low + (high - low) * static_cast<float>(random() % 8) / 7;
      for (int y = y0; y < std::min(y0 + 9, kHigh); ++y)
        for (int x = x0; x < std::min(x0 + 12, kWide); ++x) channel.At(x, y) = value;
    }
  };
  for (const std::string_view layer : {layers::kAlbedo, layers::kDirect}) {
    for (const FloatView& channel : film.pixels.AddColor(layer)) fill(channel, 0.2f, 0.9f);
  }
  for (const std::string_view name : {layers::kNormalX, layers::kNormalY}) film.pixels.Add(name);
  fill(film.pixels.Add(layers::kNormalZ), 1, 1);
  fill(film.pixels.Add(layers::kObjectId), 1, 2);
  fill(film.pixels.Add(layers::OfLevel({layers::Branch::kReflection, 1}, layers::kDistance)), 0, 1);
  const std::vector<Region> regions = RegionsOf(film);
  const std::vector<Region> turned = RegionsOf(Transposed(film));
  std::set<Region> seen;
  ForEachPixel(kWide, kHigh, [&](int x, int y) {
    const Region region = regions[static_cast<size_t>(y * kWide + x)];
    seen.insert(region);
    EXPECT_EQ(region, turned[static_cast<size_t>(x * kHigh + y)]) << x << " " << y;
  });
  EXPECT_GE(seen.size(), 4u) << "flat, textured, shadow, mirror";
}

TEST(Mse255ByRegion, SplitsTheErrorOfTheWhole) {
  EdgedImage film = EvenPlane();
  film.pixels.Get("albedo.R").At(20, 20) = 0.2f;  // textured, with its neighbours to the left and above
  const std::vector<Region> regions = RegionsOf(film);
  LayeredImage picture(kSide, kSide);
  LayeredImage reference(kSide, kSide);
  picture.AddColor("");
  reference.AddColor("");
  picture.Get("G").At(19, 20) = 1;  // textured
  picture.Get("G").At(3, 3) = 1;    // flat
  const RegionMeans means = Mse255ByRegion(ColorOf(picture), ColorOf(reference), regions);
  const double one = 65025.0 / 3;
  EXPECT_NEAR(means.whole, 2 * one / (kSide * kSide), 1e-9);
  EXPECT_NEAR(means.of_region[static_cast<size_t>(Region::kTextured)], one / 3, 1e-9);
  EXPECT_NEAR(means.of_region[static_cast<size_t>(Region::kFlat)], one / (kSide * kSide - 3), 1e-9);
  EXPECT_NEAR(means.share[static_cast<size_t>(Region::kTextured)], 3.0 / (kSide * kSide), 1e-12);
  EXPECT_EQ(means.of_region[static_cast<size_t>(Region::kEdges)], 0.0);
}

TEST(Mse255ToHalves, HasNoNoiseOfTheReferenceWhateverTheCurveDoesToIt) {
  const std::vector<Region> regions(kSide * kSide, Region::kFlat);
  const auto grey = [](float value) {
    LayeredImage image(kSide, kSide);
    image.AddColor("");
    for (const char* name : {"R", "G", "B"}) image.Get(name).At(3, 3) = value;
    return image;
  };
  const LayeredImage picture = grey(0.2f);
  const LayeredImage same = grey(0.2f);
  const LayeredImage firefly = grey(1000);  // clamped, as the mean of both halves is
  EXPECT_EQ(Mse255ToHalves(ColorOf(picture), ColorOf(firefly), ColorOf(same), regions).whole, 0.0);
  const LayeredImage other = grey(0.4f);
  EXPECT_NEAR(Mse255ToHalves(ColorOf(other), ColorOf(same), ColorOf(picture), regions).whole,
              Mse255(ColorOf(other), ColorOf(picture)), 1e-9);
}

}  // namespace
}  // namespace lumifold::metrics
