#include "client/pictures/display_file.h"

#include <gtest/gtest.h>
#include <png.h>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/file_io.h"
#include "filter/image/layered_image.h"
#include "filter/image/png_io.h"
#include "tests/support/temp_folder.h"

namespace lumifold::pictures {
namespace {

std::string Bytes(const TempFolder& folder, const std::string& name) {
  return *ReadFile(folder.PathOf(name), 1 << 20);
}

LayeredImage Ramp(int width, int height) {
  LayeredImage image(width, height);
  const ColorView color = image.AddColor("");
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x)
        color[c].At(x, y) = static_cast<float>(x + static_cast<int>(c)) / static_cast<float>(width);
    }
  }
  return image;
}

TEST(WriteDisplayed, StandardIsThePngOfTheLibrary) {
  const TempFolder folder;
  const LayeredImage image = Ramp(64, 3);
  const ConstColorView color = image.GetColor("");
  ASSERT_EQ(WriteDisplayed(folder.PathOf("a.png"), color, {.exposure = 0.7f}), absl::OkStatus());
  ASSERT_EQ(WritePng(folder.PathOf("b.png"), color, 0.7f), absl::OkStatus());
  EXPECT_EQ(Bytes(folder, "a.png"), Bytes(folder, "b.png"));
}

TEST(WriteDisplayed, TheEndOfTheNameSaysWhatIsWritten) {
  const TempFolder folder;
  const LayeredImage image = Ramp(16, 16);
  ASSERT_EQ(WriteDisplayed(folder.PathOf("a.JPG"), image.GetColor(""), {}), absl::OkStatus());
  EXPECT_EQ(Bytes(folder, "a.JPG").substr(0, 3), "\xff\xd8\xff");
  ASSERT_EQ(WriteDisplayed(folder.PathOf("low.jpeg"), image.GetColor(""), {.jpeg_quality = 5}),
            absl::OkStatus());
  EXPECT_LT(Bytes(folder, "low.jpeg").size(), Bytes(folder, "a.JPG").size());
}

/// The RGBA of a PNG.
std::vector<uint8_t> Rgba(const std::string& path) {
  png_image image = {};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_file(&image, path.c_str()), 0);
  image.format = PNG_FORMAT_RGBA;
  std::vector<uint8_t> bytes(PNG_IMAGE_SIZE(image));
  EXPECT_NE(png_image_finish_read(&image, nullptr, bytes.data(), 0, nullptr), 0);
  return bytes;
}

TEST(WriteDisplayed, APngHasTheLightOfWhatIsCoveredAndA) {
  const TempFolder folder;
  LayeredImage image(3, 1);
  const FloatView alpha = image.Add("A");
  const float covered[3] = {1, 0.5f, 0};
  for (int x = 0; x < 3; ++x) alpha.At(x, 0) = covered[x];
  for (const FloatView& channel : image.AddColor("")) {
    channel.At(0, 0) = 0.2f;
    channel.At(1, 0) = 0.1f;  // half of a pixel of the same surface
  }
  const ConstFloatView seen = std::as_const(image).Get("A");
  const uint8_t grey = 124;  // of 0.2
  for (const std::optional<float> exposure : {std::optional<float>(1), std::optional<float>()}) {
    ASSERT_EQ(WriteDisplayed(folder.PathOf("a.png"), std::as_const(image).GetColor(""),
                             {.exposure = exposure}, &seen),
              absl::OkStatus());
    const std::vector<uint8_t> bytes = Rgba(folder.PathOf("a.png"));
    EXPECT_TRUE(bytes[0] == grey || !exposure.has_value()) << int{bytes[0]};
    EXPECT_EQ(bytes[4], bytes[0]) << "no fringe";
    EXPECT_EQ(bytes[3], 255);
    EXPECT_EQ(bytes[7], 128);
    EXPECT_EQ(bytes[11], 0);
  }
  ASSERT_EQ(WriteDisplayed(folder.PathOf("a.jpg"), std::as_const(image).GetColor(""), {}, &seen),
            absl::OkStatus());
}

TEST(DisplayWriter, RowsGiveTheFileOfTheWhole) {
  const TempFolder folder;
  const LayeredImage image = Ramp(8, 7);
  for (const std::optional<float> exposure : {std::optional<float>(1), std::optional<float>()}) {
    const DisplayOptions options = {.view = "filmic", .exposure = exposure};
    ASSERT_EQ(WriteDisplayed(folder.PathOf("whole.png"), image.GetColor(""), options), absl::OkStatus());
    absl::StatusOr<DisplayWriter> writer = DisplayWriter::Create(folder.PathOf("rows.png"), 8, 7, options);
    ASSERT_TRUE(writer.ok());
    LayeredImage part;
    for (const Rect& rows : {Rect{0, 0, 8, 3}, Rect{0, 3, 8, 4}, Rect{0, 4, 8, 7}})
      writer->Append(std::as_const(part = image.Crop(rows)).GetColor(""));
    ASSERT_EQ(writer->Finish(), absl::OkStatus());
    EXPECT_EQ(Bytes(folder, "rows.png"), Bytes(folder, "whole.png"));
  }
}

TEST(WriteDisplayed, SaysWhatIsWrong) {
  const TempFolder folder;
  const LayeredImage image = Ramp(2, 2);
  EXPECT_TRUE(
      absl::IsInvalidArgument(WriteDisplayed(folder.PathOf("a.png"), image.GetColor(""), {.view = "none"})));
  EXPECT_TRUE(absl::IsUnavailable(WriteDisplayed(folder.PathOf("none/a.png"), image.GetColor(""), {})));
  const LayeredImage wide = Ramp(65501, 1);
  EXPECT_TRUE(absl::IsInvalidArgument(WriteDisplayed(folder.PathOf("a.jpg"), wide.GetColor(""), {})));
}

}  // namespace
}  // namespace lumifold::pictures
