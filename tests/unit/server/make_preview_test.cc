#include "server/preview/make_preview.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "filter/methods.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/plane_codec.h"
#include "server/film/matte.h"
#include "server/film/result.h"
#include "tests/support/film_of_units.h"
#include "tests/unit/server/committed_frame_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;
using ::testing::Gt;
using ::testing::HasSubstr;

using job::JobId;

const JobId kPreviewJob("j-1");

LayeredImage PictureOf(const v1::Preview& preview) {
  absl::StatusOr<LayeredImage> picture = rpc::ImageFromBytes(preview.layout(), preview.planes(), {});
  EXPECT_TRUE(picture.ok()) << picture.status();
  return *std::move(picture);
}

class MakePreviewTest : public CommittedFrameFixture {
 protected:
  absl::StatusOr<v1::Preview> Make() {
    return MakePreview(folder_, *store_, kPreviewJob, 0, {}, /*pool=*/nullptr);
  }
};

TEST_F(MakePreviewTest, OfAllUnitsItIsTheFilteredFilm) {
  const v1::JobSpec spec = Spec(40, 30);
  Commit(kPreviewJob, spec);
  const absl::StatusOr<v1::Preview> preview = Make();
  ASSERT_TRUE(preview.ok()) << preview.status();
  EXPECT_EQ(preview->units(), job::FrameUnits(spec).count());
  EXPECT_EQ(preview->width(), 40);
  EXPECT_EQ(preview->height(), 30);
  EXPECT_EQ(preview->reduction(), 1);
  EXPECT_EQ(preview->samples_per_pixel(), 10);

  LayeredImage film = std::move(WholeFilm(spec, 0, RandomUnitsOf(spec, 1))->pixels);
  std::array<Plane, 3> filtered = *filter::FilterFilm(film, "default", nullptr);
  LayeredImage expected = film::BuildResult({std::move(film), {}}, std::move(filtered), {}).pixels;
  const LayeredImage picture = PictureOf(*preview);
  for (LayeredImage::Channel& channel : expected.channels()) {
    if (channel.name != "id.Y" && channel.name != "Z" && channel.name != "distance.Z")
      rpc::RoundToHalf(channel.plane.view());
    for (int y = 0; y < 30; ++y) {
      for (int x = 0; x < 40; ++x)
        ASSERT_EQ(picture.Get(channel.name).At(x, y), channel.plane.At(x, y)) << channel.name;
    }
  }
}

TEST_F(MakePreviewTest, ATransparentPictureHasA) {
  v1::JobSpec spec = Spec(40, 30);
  Commit(JobId("j-2"), spec);
  spec.set_background(v1::BACKGROUND_TRANSPARENT);
  Commit(kPreviewJob, spec, /*is_forward=*/true, [](const job::UnitKey& key) { return key.tile != 3; });
  const absl::StatusOr<v1::Preview> preview = Make();
  ASSERT_TRUE(preview.ok()) << preview.status();
  for (const std::string layer : {"", "noisy"}) {
    const absl::StatusOr<v1::Preview> part = LayerOfPreview(*preview, layer);
    ASSERT_TRUE(part.ok()) << part.status();
    ASSERT_EQ(part->layout().channels_size(), 4);
    EXPECT_EQ(part->layout().channels(3), "A");
    EXPECT_GT(PictureOf(*part).Get("A").At(28, 4), 0) << "also in tiles that nobody has rendered";
  }
  EXPECT_EQ(LayerOfPreview(*preview, "albedo")->layout().channels_size(), 3);

  EdgedImage film = *WholeFilm(spec, 0, RandomUnitsOf(spec, 1));
  film.pixels.Add(layers::kShadow,
                  std::move((*filter::FilterFilm(film::ShadowFilmOf(film.pixels), "default", nullptr))[0]));
  const Plane expected = film::AlphaOf({std::move(film.pixels), {}, {}}, /*is_filtered=*/true);
  EXPECT_NEAR(PictureOf(*preview).Get("A").At(4, 20), expected.At(4, 20), 0.3) << "shadows included";

  const absl::StatusOr<v1::Preview> opaque =
      MakePreview(folder_, *store_, JobId("j-2"), 0, {}, /*pool=*/nullptr);
  ASSERT_TRUE(opaque.ok()) << opaque.status();
  EXPECT_EQ(LayerOfPreview(*opaque, "")->layout().channels_size(), 3);
}

TEST_F(MakePreviewTest, TheErrorIsMissingWhereTheMethodDoesNotKnowIt) {
  v1::JobSpec spec = Spec(16, 16);
  spec.mutable_filter()->set_method("bilateral");
  Commit(kPreviewJob, spec, /*is_forward=*/true, [](const job::UnitKey& key) { return key.tile < 3; });
  const absl::StatusOr<v1::Preview> preview = Make();
  ASSERT_TRUE(preview.ok()) << preview.status();
  EXPECT_FALSE(PictureOf(*preview).Has("error.Y"));
  EXPECT_TRUE(absl::IsInvalidArgument(LayerOfPreview(*preview, "error").status()));
  EXPECT_TRUE(LayerOfPreview(*preview, "samples").ok());
}

TEST_F(MakePreviewTest, TilesWithoutPassesAreCoarseAndOthersHaveTheSamplesThatTheyHave) {
  // Of four tiles, the first has all passes, the second the first pass, the third its geometry, the fourth
  // nothing.
  Commit(kPreviewJob, Spec(16, 16), /*is_forward=*/true, [](const job::UnitKey& key) {
    const bool is_geometry = key.kind == v1::UNIT_KIND_GEOMETRY;
    return key.tile == 0 || (key.tile == 1 && key.pass == 0) || (key.tile == 2 && is_geometry);
  });
  const absl::StatusOr<v1::Preview> preview = Make();
  ASSERT_TRUE(preview.ok()) << preview.status();
  EXPECT_EQ(preview->samples_per_pixel(), (10 + 4) / 4.0);
  const LayeredImage picture = PictureOf(*preview);
  const auto at = [&picture](const std::string& channel) {
    const ConstFloatView view = picture.Get(channel);
    return std::vector<float>{view.At(2, 2), view.At(10, 2), view.At(2, 10), view.At(10, 10)};
  };
  EXPECT_THAT(at("samples.Y"), ElementsAre(10, 4, 0, 0));
  EXPECT_THAT(at("error.Y"), ElementsAre(Gt(0), Gt(0), 0, 0)) << "the halves of one pass tell it";
  EXPECT_GT(at("noisy.G")[1], 0);
  EXPECT_EQ(at("noisy.G")[2], 0);
  EXPECT_GT(at("G")[2], 0) << "as bright as what is around it";
  EXPECT_GT(at("G")[3], 0);
  EXPECT_NE(at("N.X")[2], 0);
  EXPECT_EQ(at("N.X")[3], 0);
  for (const LayeredImage::Channel& channel : picture.channels()) {
    for (const float value : at(channel.name)) EXPECT_TRUE(std::isfinite(value)) << channel.name;
  }
}

TEST_F(MakePreviewTest, ALargeFrameIsReduced) {
  Commit(kPreviewJob, Spec(1030, 9), /*is_forward=*/true,
         [](const job::UnitKey& key) { return key.pass == 0; });
  const absl::StatusOr<v1::Preview> preview = Make();
  ASSERT_TRUE(preview.ok()) << preview.status();
  EXPECT_EQ(preview->reduction(), 3);
  EXPECT_EQ(preview->layout().width(), 344);
  EXPECT_EQ(preview->layout().height(), 3);
  const LayeredImage picture = PictureOf(*preview);
  EXPECT_EQ(picture.Get("samples.Y").At(0, 0), 4) << "a pixel of the frame has these, not a block";
}

TEST_F(MakePreviewTest, AFrameOfFewSamplesIsReduced) {
  v1::JobSpec large = Spec(260, 9);
  large.set_first_pass_samples(2);
  Commit(kPreviewJob, large, /*is_forward=*/true,
         [](const job::UnitKey& key) { return key.pass == 0 && key.tile < 20; });
  const absl::StatusOr<v1::Preview> preview = Make();
  ASSERT_TRUE(preview.ok()) << preview.status();
  EXPECT_EQ(preview->reduction(), 2);
  EXPECT_EQ(preview->layout().width(), 130);
  EXPECT_EQ(preview->layout().height(), 5);
  EXPECT_EQ(PictureOf(*preview).Get("samples.Y").At(0, 0), 2);
}

TEST_F(MakePreviewTest, ASmallFrameIsNotReduced) {
  v1::JobSpec small = Spec(250, 9);
  small.set_first_pass_samples(2);
  Commit(kPreviewJob, small, /*is_forward=*/true, [](const job::UnitKey& key) { return key.pass == 0; });
  EXPECT_EQ(Make()->reduction(), 1);
}

TEST_F(MakePreviewTest, ARegionHasItsPixelsAndNoOthers) {
  const v1::JobSpec spec = Spec(1030, 20);
  Commit(kPreviewJob, spec);
  const Rect region = {601, 3, 1030, 20};
  const absl::StatusOr<v1::Preview> preview =
      MakePreview(folder_, *store_, kPreviewJob, 0, {.region = region}, nullptr);
  ASSERT_TRUE(preview.ok()) << preview.status();
  EXPECT_EQ(preview->reduction(), 1);
  EXPECT_EQ(preview->region().x1(), 1030);
  const LayeredImage film = std::move(WholeFilm(spec, 0, RandomUnitsOf(spec, 1))->pixels);
  const LayeredImage picture = PictureOf(*preview);
  ASSERT_EQ(picture.width(), region.width());
  ASSERT_EQ(picture.height(), region.height());
  for (int y = 0; y < region.height(); ++y) {
    for (int x = 0; x < region.width(); ++x)
      ASSERT_EQ(picture.Get("Z").At(x, y), film.Get("Z").At(region.x0 + x, region.y0 + y));
  }
  const Rect outside = {601, 3, 1031, 20};
  EXPECT_EQ(MakePreview(folder_, *store_, kPreviewJob, 0, {.region = outside}, nullptr).status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST_F(MakePreviewTest, WithoutUnitsThereIsNone) {
  Commit(kPreviewJob, Spec(16, 16), /*is_forward=*/true, [](const job::UnitKey&) { return false; });
  EXPECT_EQ(Make().status().code(), absl::StatusCode::kOutOfRange);
}

TEST_F(MakePreviewTest, ALayerIsTakenOutOfIt) {
  Commit(kPreviewJob, Spec(16, 16));
  const v1::Preview all = *Make();
  const auto channels = [&all](const std::string& layer) {
    const absl::StatusOr<v1::Preview> part = LayerOfPreview(all, layer);
    EXPECT_TRUE(part.ok()) << part.status();
    const LayeredImage picture = PictureOf(*part);
    std::vector<std::string> names;
    for (const LayeredImage::Channel& channel : picture.channels()) {
      names.push_back(channel.name);
      EXPECT_EQ(channel.plane.At(3, 5), PictureOf(all).Get(channel.name).At(3, 5));
    }
    EXPECT_EQ(part->units(), all.units());
    return names;
  };
  EXPECT_THAT(channels(""), ElementsAre("R", "G", "B"));
  EXPECT_THAT(channels("noisy"), ElementsAre("noisy.R", "noisy.G", "noisy.B"));
  EXPECT_THAT(channels("N"), ElementsAre("N.X", "N.Y", "N.Z"));
  EXPECT_THAT(channels("Z"), ElementsAre("Z"));
  EXPECT_THAT(channels("id"), ElementsAre("id.Y"));
  EXPECT_THAT(channels("samples"), ElementsAre("samples.Y"));
  EXPECT_THAT(channels("error"), ElementsAre("error.Y"));
  for (const char* unknown : {"nois", "noisy.", ".", "samples.Y."}) {
    const absl::Status status = LayerOfPreview(all, unknown).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << unknown;
    EXPECT_THAT(std::string(status.message()), HasSubstr(R"("direct", "indirect", "albedo")"));
  }
}

/// Those of an OpenEXR file are sorted by name.
TEST(LayerOfPreviewTest, TheChannelsOfAColourAreRedGreenAndBlueInAnyFile) {
  LayeredImage sorted(1, 1);
  for (const auto& [channel, value] : {std::pair("B", 3.0F), std::pair("G", 2.0F), std::pair("R", 1.0F)}) {
    Plane plane(1, 1);
    plane.At(0, 0) = value;
    sorted.Add(channel, std::move(plane));
  }
  rpc::EncodedPicture encoded = rpc::EncodePicture(sorted);
  v1::Preview all;
  *all.mutable_layout() = std::move(encoded.layout);
  all.set_planes(std::move(encoded.bytes));
  const LayeredImage picture = PictureOf(*LayerOfPreview(all, ""));
  std::vector<std::pair<std::string, float>> values;
  for (const LayeredImage::Channel& channel : picture.channels())
    values.emplace_back(channel.name, channel.plane.At(0, 0));
  EXPECT_THAT(values, ElementsAre(std::pair("R", 1.0F), std::pair("G", 2.0F), std::pair("B", 3.0F)));
}

}  // namespace
}  // namespace lumifold::server
