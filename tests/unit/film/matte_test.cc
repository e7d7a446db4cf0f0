#include "server/film/matte.h"

#include <gtest/gtest.h>

#include "filter/image/layers.h"

namespace lumifold::film {
namespace {

/// Two pixels with 16 samples a half, of which the right one is an edge.
EdgedImage Film(float opacity, float covered) {
  EdgedImage film;
  film.pixels = LayeredImage(2, 1);
  for (const std::string_view name : layers::kMatte) film.pixels.Add(name);
  for (const std::string_view name : {layers::kAlpha, layers::kSamplesA, layers::kSamplesB})
    film.pixels.Add(name);
  for (int x = 0; x < 2; ++x) {
    film.pixels.Get(layers::kOpacity).At(x, 0) = opacity;
    film.pixels.Get(layers::kAlpha).At(x, 0) = covered;
    film.pixels.Get(layers::kSamplesA).At(x, 0) = film.pixels.Get(layers::kSamplesB).At(x, 0) = 16;
  }
  film.edges = LayeredImage::List(kSubSamples, 1);
  film.edges.Add(layers::kPixelX).At(0, 0) = 1;
  film.edges.Add(layers::kPixelY);
  return film;
}

TEST(Matte, EdgesHaveTheCoverageOfTheFilteredPicture) {
  const EdgedImage film = Film(0.5f, 0.25f);
  const Plane plain = AlphaOf(film, /*is_filtered=*/false);
  EXPECT_EQ(plain.At(0, 0), 0.5f);
  EXPECT_EQ(plain.At(1, 0), 0.5f);
  const Plane filtered = AlphaOf(film, /*is_filtered=*/true);
  EXPECT_EQ(filtered.At(0, 0), 0.5f);
  EXPECT_EQ(filtered.At(1, 0), 0.375f);  // 16 samples a half count as much as 16 sub-samples
}

TEST(Matte, AShadowIsOnWhatTheOpacityLeaves) {
  EdgedImage film = Film(0.5f, 0.25f);
  const FloatView shadow = film.pixels.Add(layers::kShadow);
  shadow.At(0, 0) = shadow.At(1, 0) = 0.2f;
  const Plane alpha = AlphaOf(film, /*is_filtered=*/true);
  EXPECT_FLOAT_EQ(alpha.At(0, 0), 0.7f);
  EXPECT_FLOAT_EQ(alpha.At(1, 0), 0.375f + 0.4f * 0.625f);
  shadow.At(0, 0) = 0.9f;
  EXPECT_EQ(AlphaOf(film, true).At(0, 0), 1) << "at most";
  film.pixels.Get(layers::kOpacity).At(0, 0) = 1;
  EXPECT_EQ(AlphaOf(film, true).At(0, 0), 1);
}

TEST(Matte, ShadowsAreAPartOfTheLight) {
  LayeredImage film = Film(0, 0).pixels;
  film.Get(layers::kCatcher).At(1, 0) = 0.5f;
  film.Get(layers::kCatcherLight[0]).At(1, 0) = 4;
  film.Get(layers::kCatcherLight[1]).At(1, 0) = 2;
  film.Get(layers::kCatcherShadow[0]).At(1, 0) = 1;
  film.Get(layers::kCatcherShadow[1]).At(1, 0) = 2;
  const LayeredImage shadows = ShadowFilmOf(film);
  EXPECT_EQ(shadows.Get("direct_a.G").At(1, 0), 0.25f);
  EXPECT_EQ(shadows.Get("direct_b.G").At(1, 0), 1);
  EXPECT_EQ(shadows.Get("direct.R").At(1, 0), 0.5f);  // not the mean of the halves' ratios
  EXPECT_EQ(shadows.Get("noisy.R").At(1, 0), 0.25f);
  EXPECT_EQ(shadows.Get("albedo.B").At(1, 0), 0.5f);
  EXPECT_EQ(shadows.Get(layers::kMask).At(1, 0), 0.5f);
  EXPECT_EQ(shadows.Get("direct.R").At(0, 0), 0);
  EXPECT_EQ(shadows.Get(layers::kSamplesA).At(0, 0), 16);
}

}  // namespace
}  // namespace lumifold::film
