#include "filter/image/png_io.h"

#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <vector>

#include "filter/image/layered_image.h"
#include "tests/support/temp_folder.h"

namespace lumifold {
namespace {

TEST(Png, WritesSrgbBytes) {
  const TempFolder folder;
  const std::string path = folder.PathOf("picture.png");
  LayeredImage image(2, 1);
  const ColorView color = image.AddColor("");
  color[0].At(0, 0) = 0.5f;   // 188 in sRGB
  color[1].At(0, 0) = 9.0f;   // clamps
  color[2].At(0, 0) = -1.0f;  // clamps
  color[0].At(1, 0) = NAN;
  color[1].At(1, 0) = 0.0021f;
  ASSERT_TRUE(WritePng(path, std::as_const(image).GetColor("")).ok());

  png_image decoded = {};
  decoded.version = PNG_IMAGE_VERSION;
  ASSERT_NE(png_image_begin_read_from_file(&decoded, path.c_str()), 0);
  decoded.format = PNG_FORMAT_RGB;
  std::vector<png_byte> bytes(PNG_IMAGE_SIZE(decoded));
  ASSERT_NE(png_image_finish_read(&decoded, nullptr, bytes.data(), 0, nullptr), 0);
  EXPECT_EQ(bytes, (std::vector<png_byte>{188, 255, 0, 0, 7, 0}));
}

TEST(Png, RefusesAnEmptyPicture) {
  EXPECT_EQ(WritePng("unused.png", ConstColorView{}).code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace lumifold
