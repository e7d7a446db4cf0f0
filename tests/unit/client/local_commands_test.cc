// Commands that work on files of this machine.

#include <gmock/gmock.h>

#include <filesystem>

#include "tests/unit/client/run_client_fixture.h"

namespace lumifold::client {
namespace {

using testing::MatchesRegex;
using testing::StartsWith;

TEST_F(RunClientTest, ComparesLayers) {
  LayeredImage image(4, 3);
  image.AddColor("");
  for (const FloatView& plane : image.AddColor("noisy")) {
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 4; ++x) plane.At(x, y) = 1;
    }
  }
  const std::string picture = folder_.File("picture.exr");
  ASSERT_EQ(WriteExr(picture, image), absl::OkStatus());
  EXPECT_EQ(Run({"compare", picture, picture, "--layer", "noisy"}), 0) << Err();
  EXPECT_EQ(Out(), "MSE255 65025.0000\nPSNR 0.00 dB\nrelMSE 100.000000\n");
  test_.out.str("");
  EXPECT_EQ(Run({"compare", picture, picture, "--json"}), 0);
  EXPECT_EQ(Out(), "{\"schema_version\":1,\"mse255\":0.0,\"psnr_db\":null,\"rel_mse\":0.0}\n");
}

TEST_F(RunClientTest, RefusesToCompareWhatDoesNotFit) {
  const std::string small = folder_.File("result");
  const std::string large = folder_.File("large.exr");
  LayeredImage image(5, 3);
  image.AddColor("");
  ASSERT_EQ(WriteExr(large, image), absl::OkStatus());
  EXPECT_EQ(Run({"compare", small, large}), 2);
  EXPECT_EQ(Run({"compare", small, small, "--layer", "direct"}), 4);
  EXPECT_EQ(Run({"compare", small, folder_.File("none.exr")}), 4);
  EXPECT_THAT(Err(), StartsWith("lumifold: " + small + " has 4x3 pixels, " + large +
                                " has 5x3\nlumifold: " + small + ": has no colour layer 'direct'"));
}

TEST_F(RunClientTest, ComparesByRegionAndWritesAHeatMap) {
  LayeredImage image(4, 3);
  image.AddColor("");
  image.AddColor("albedo");
  const std::string reference = folder_.File("reference.exr");
  ASSERT_EQ(WriteExr(reference, image), absl::OkStatus());
  image.Get("G").At(1, 1) = 1;
  const std::string picture = folder_.File("picture.exr");
  ASSERT_EQ(WriteExr(picture, image), absl::OkStatus());
  const std::string map = folder_.File("map.png");
  EXPECT_EQ(Run({"compare", picture, reference, "--metric", "mse255,flip", "--by-region", "--heatmap", map}),
            0)
      << Err();
  EXPECT_THAT(Out(), MatchesRegex("MSE255 1806\\.2500\nFLIP 0\\.[0-9]*\nMSE255 of flat 1806\\.2500 "
                                  "\\(100\\.0 % of pixels\\)\n.*map\\.png: black is 0, pale yellow is 200 or "
                                  "more 8-bit steps \\(root mean square of R G B\\)\n"));
  EXPECT_TRUE(std::filesystem::exists(map));
  test_.out.str("");
  EXPECT_EQ(
      Run({"compare", picture, reference, "--metric", "mse255", "--by-region", "--heatmap", map, "--json"}),
      0);
  EXPECT_EQ(
      Out(),
      "{\"schema_version\":1,\"mse255\":1806.25,\"regions\":{\"flat\":{\"share\":1.0,\"mse255\":1806.25}},"
      "\"heatmap_scale\":200.0}\n");
}

TEST_F(RunClientTest, NamesTheReasonWhyItCannotCompareByRegion) {
  LayeredImage image(4, 3);
  image.AddColor("");
  const std::string picture = folder_.File("picture.exr");
  ASSERT_EQ(WriteExr(picture, image), absl::OkStatus());
  EXPECT_EQ(Run({"compare", picture, picture, "--by-region"}), 4);
  EXPECT_EQ(Run({"compare", picture, picture, "--heatmap", "map.jpg"}), 2);
  EXPECT_EQ(Err(), "lumifold: " + picture +
                       ": has no layers that define regions: 'albedo', 'direct' or edges\nlumifold: "
                       "--heatmap: expected a name that ends in .png; got 'map.jpg'\n");
}

TEST_F(RunClientTest, ConvertSaysThatAPictureIsMissing) {
  EXPECT_EQ(Run({"convert", folder_.File("none.exr"), "-o", folder_.File("out.png")}), 4);
  EXPECT_EQ(Err(), "lumifold: " + folder_.File("none.exr") + ": no such file\n");
}

TEST_F(RunClientTest, HelpOfACommandIsItsOwn) {
  EXPECT_EQ(Run({"convert", "--help"}), 0);
  const std::string help = Out();
  EXPECT_THAT(help, testing::HasSubstr("\nExample: lumifold convert picture.exr -o picture.png"));
  test_.out.str("");
  EXPECT_EQ(Run({"help", "convert"}), 0);
  EXPECT_EQ(Out(), help);
  EXPECT_EQ(Run({"help", "kovert"}), 2);
  EXPECT_EQ(Run({"help", "--help"}), 0);
}

TEST_F(RunClientTest, FiltersAPictureForADisplayWithAWarning) {
  const std::string picture = folder_.Write("photo.png", "a photo");
  const int files = folder_.FileCount();
  test_.environment.local.displayed_reader = [&](const std::string& path) {
    EXPECT_EQ(path, picture);
    LayeredImage image(4, 3);
    image.AddColor("");
    image.Get("G").At(2, 1) = 0.5f;
    return image;
  };
  test_.environment.local.film_filter = [this](FilmSource* film, const std::string&,
                                               const FilterMachine& machine, const std::vector<std::string>&,
                                               const RowSink& sink,
                                               const std::function<void(double)>& progress) {
    EXPECT_EQ(machine.device, "gpu:1");
    machine.warn("the GPU fails");
    test_.time.now += absl::Seconds(4);
    progress(0.25);
    absl::StatusOr<EdgedImage> read = film->Read({0, 0, 4, 3});
    if (!read.ok()) return read.status();
    EXPECT_EQ(read->pixels.Get("noisy.G").At(2, 1), 0.5f);
    LayeredImage rows(4, 3);
    for (const char* layer : {"", "noisy"}) rows.AddColor(layer);
    rows.Add("A");
    return sink(rows);
  };
  EXPECT_EQ(Run({"filter", picture, "--device", "gpu:1", "-o", folder_.File("out.exr")}), 0) << Err();
  EXPECT_THAT(Err(), testing::HasSubstr("the GPU fails"));
  EXPECT_THAT(Err(), testing::HasSubstr("photo.png: a picture for a display: light brighter than white"));
  EXPECT_THAT(Err(), testing::HasSubstr("filtering 25%"));
  EXPECT_EQ(folder_.FileCount(), files + 1) << "the copy is removed";
  test_.environment.local.displayed_reader = nullptr;
  EXPECT_EQ(Run({"filter", picture, "-o", folder_.File("out.exr")}), 1);
}

TEST_F(RunClientTest, InterruptedFilteringLeavesNoFile) {
  const std::string picture = folder_.File("picture.exr");
  LayeredImage image(4, 3);
  image.AddColor("noisy");
  ASSERT_EQ(WriteExr(picture, image), absl::OkStatus());
  const int files = folder_.FileCount();
  test_.environment.local.film_filter =
      [](FilmSource* film, const std::string&, const FilterMachine&, const std::vector<std::string>&,
         const RowSink&, const std::function<void(double)>&) { return film->Read({0, 0, 4, 3}).status(); };
  test_.interrupted = true;
  EXPECT_EQ(Run({"filter", picture, "-o", folder_.File("out.exr")}), 130);
  EXPECT_THAT(Err(), testing::EndsWith("lumifold: interrupted\n"));
  EXPECT_EQ(folder_.FileCount(), files);
}

}  // namespace
}  // namespace lumifold::client
