#include "server/film/result.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/film/assemble.h"
#include "tests/support/random_unit.h"

namespace lumifold::film {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Not;

v1::JobSpec Spec() {
  v1::JobSpec spec;
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

LayeredImage Result(const v1::JobSpec& spec) {
  const scheduler::FrameUnits units(spec);
  absl::StatusOr<LayeredImage> film = AssembleFilm(
      spec, 0,
      [&](const scheduler::UnitKey& key) {
        return absl::StatusOr<LayeredImage>(
            RandomUnit(key, units.tiles().RectOf(key.tile), units.SamplesOf(key), 1));
      },
      nullptr);
  std::array<Plane, 3> filtered = {Plane(9, 4), Plane(9, 4), Plane(9, 4)};
  filtered[1].Fill(0.5f);
  return BuildResult(*std::move(film), std::move(filtered),
                     {.spec = spec, .frame = 3, .numeric_class = "avx2"});
}

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
       {"noisy_a.R", "direct_b.G", "reflection1_a.B", "mask.Y", "samples_a.Y", "samples_b.Y"}) {
    EXPECT_THAT(names, Contains(name));
    EXPECT_THAT(Names(Result(Spec())), Not(Contains(name)));
  }
}

TEST(Result, SaysHowItWasMade) {
  const auto metadata = Result(Spec()).metadata();
  EXPECT_EQ(metadata.at("lumifold.scene"), "room.glb");
  EXPECT_EQ(metadata.at("lumifold.size"), "9x4");
  EXPECT_EQ(metadata.at("lumifold.samples_per_pixel"), "16");
  EXPECT_EQ(metadata.at("lumifold.seed"), "42");
  EXPECT_EQ(metadata.at("lumifold.filter"), "none");
  EXPECT_EQ(metadata.at("lumifold.numeric_class"), "avx2");
  EXPECT_EQ(metadata.at("lumifold.frame"), "3");
}

}  // namespace
}  // namespace lumifold::film
