#include "server/film/result.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "filter/image/exr_io.h"
#include "tests/support/film_of_units.h"
#include "tests/support/temp_folder.h"

namespace lumifold::film {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Not;

v1::JobSpec Spec() {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.mutable_scene()->set_display_name("room.glb");
  spec.set_width(9);
  spec.set_height(4);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(16);
  spec.set_pass_samples(8);
  spec.set_seed(42);
  spec.set_max_bounces(5);
  spec.mutable_filter()->set_method("none");
  return spec;
}

EdgedImage FilmOf(const v1::JobSpec& spec) { return *WholeFilm(spec, 0, RandomUnitsOf(spec, 1)); }

EdgedImage EdgedResult(const v1::JobSpec& spec) {
  std::array<Plane, 3> filtered = {Plane(9, 4), Plane(9, 4), Plane(9, 4)};
  filtered[1].Fill(0.5f);
  return BuildResult(FilmOf(spec), std::move(filtered), {.spec = spec, .frame = 3, .numeric_class = "avx2"});
}

LayeredImage Result(const v1::JobSpec& spec) { return EdgedResult(spec).pixels; }

std::vector<std::string> Names(const LayeredImage& image) {
  std::vector<std::string> names;
  for (const LayeredImage::Channel& channel : image.channels()) names.push_back(channel.name);
  return names;
}

TEST(Result, HoldsTheUsualLayers) {
  const LayeredImage result = Result(Spec());
  EXPECT_THAT(Names(result),
              ElementsAre("R", "G", "B", "A", "noisy.R", "noisy.G", "noisy.B", "direct.R", "direct.G",
                          "direct.B", "indirect.R", "indirect.G", "indirect.B", "albedo.R", "albedo.G",
                          "albedo.B", "emission.R", "emission.G", "emission.B", "reflection1.R",
                          "reflection1.G", "reflection1.B", "N.X", "N.Y", "N.Z", "Z", "distance.Z", "id.Y"));
  EXPECT_EQ(result.Get("G").At(3, 3), 0.5f);
}

TEST(Result, KeepsTheWholeFilmWhenAsked) {
  v1::JobSpec spec = Spec();
  spec.set_save_film(true);
  const std::vector<std::string> names = Names(Result(spec));
  for (const char* name :
       {"noisy_a.R", "direct_b.G", "glossy_a.B", "glossy_albedo.R", "mask.Y", "roughness.Y", "samples_a.Y",
        "reflection1_direct_a.R", "reflection1_N.X", "reflection1_samples_b.Y"}) {
    EXPECT_THAT(names, Contains(name));
    EXPECT_THAT(Names(Result(Spec())), Not(Contains(name)));
  }
}

TEST(Result, OfATransparentPictureHasItsOpacity) {
  v1::JobSpec spec = Spec();
  spec.set_background(v1::BACKGROUND_TRANSPARENT);
  const LayeredImage plain = Result(spec);
  EXPECT_EQ(Names(plain), Names(Result(Spec())));
  EXPECT_EQ(plain.metadata().at("lumifold.background"), "transparent");
  spec.set_save_film(true);
  const LayeredImage film = Result(spec);
  EXPECT_THAT(Names(film), Contains("opacity.Y"));
  EXPECT_EQ(film.Get("A").At(3, 2), std::clamp(film.Get("opacity.Y").At(3, 2), 0.0f, 1.0f));
}

TEST(Result, ReflectionIsWhatTheOtherLayersLeave) {
  const LayeredImage result = Result(Spec());
  const auto at = [&](const char* name) { return result.Get(name).At(5, 2); };
  EXPECT_FLOAT_EQ(at("reflection1.B"),
                  at("noisy.B") - (at("direct.B") + at("indirect.B")) * at("albedo.B") - at("emission.B"));
}

TEST(Result, ASavedFilmIsReadBackWhole) {
  v1::JobSpec spec = Spec();
  spec.set_save_film(true);
  const TempFolder folder;
  const std::string path = folder.PathOf("film.exr");
  ASSERT_TRUE(WriteExr(path, EdgedResult(spec)).ok());
  const EdgedImage film = FilmOf(spec);
  const absl::StatusOr<EdgedImage> read = ReadEdgedExr(path);
  ASSERT_TRUE(read.ok()) << read.status();
  const auto expect_same = [](const LayeredImage& expected, const LayeredImage& image) {
    ASSERT_EQ(image.bounds(), expected.bounds());
    for (const LayeredImage::Channel& channel : expected.channels()) {
      ASSERT_TRUE(image.Has(channel.name)) << channel.name;
      for (int y = 0; y < expected.height(); ++y) {
        for (int x = 0; x < expected.width(); ++x)
          ASSERT_EQ(image.Get(channel.name).At(x, y), channel.plane.At(x, y)) << channel.name;
      }
    }
  };
  expect_same(film.pixels, read->pixels);
  ASSERT_GT(film.edges.height(), 0);
  expect_same(film.edges, read->edges);
  ASSERT_GT(film.fragments.height(), 0);
  expect_same(film.fragments, read->fragments);
  expect_same(film.pixels, *ReadExr(path));
}

TEST(Result, SaysHowItWasMade) {
  const auto metadata = Result(Spec()).metadata();
  EXPECT_EQ(metadata.at("lumifold.scene"), "room.glb");
  EXPECT_EQ(metadata.at("lumifold.size"), "9x4");
  EXPECT_EQ(metadata.at("lumifold.samples_per_pixel"), "16");
  EXPECT_EQ(metadata.at("lumifold.seed"), "42");
  EXPECT_EQ(metadata.at("lumifold.method"), "none");
  EXPECT_EQ(metadata.at("lumifold.numeric_class"), "avx2");
  EXPECT_EQ(metadata.at("lumifold.frame"), "3");
}

}  // namespace
}  // namespace lumifold::film
