#include "filter/image/png_io.h"

#include <png.h>

#include <cmath>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "filter/image/color.h"
#include "filter/image/file_io.h"
#include "filter/image/planes.h"

namespace lumifold {

absl::Status WritePng(const std::string& path, const ConstColorView& linear, float exposure) {
  const int width = linear[0].width();
  const int height = linear[0].height();
  std::vector<uint8_t> bytes;
  bytes.reserve(size_t{3} * static_cast<size_t>(width) * static_cast<size_t>(height));
  ForEachPixel(width, height, [&](int x, int y) {
    for (const ConstFloatView& channel : linear) {
      const float encoded = SrgbFromLinear(exposure * channel.At(x, y));
      bytes.push_back(static_cast<uint8_t>(std::lround(255.0f * encoded)));
    }
  });
  return WritePngBytes(path, width, height, bytes);
}

absl::Status WritePngBytes(const std::string& path, int width, int height,
                           const std::vector<uint8_t>& bytes) {
  if (width <= 0 || height <= 0)
    return absl::InvalidArgumentError(absl::StrCat("cannot write ", path, ": the picture has no pixels"));
  const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
  const bool has_alpha = bytes.size() == 4 * pixels;
  LUMIFOLD_CHECK(has_alpha || bytes.size() == 3 * pixels);
  png_image image = {};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = has_alpha ? PNG_FORMAT_RGBA : PNG_FORMAT_RGB;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string encoded(size, '\0');
  if (png_image_write_to_memory(&image, encoded.data(), &size, 0, bytes.data(), 0, nullptr) == 0) {
    return absl::InternalError(absl::StrCat("cannot encode ", path, ": ", image.message));
  }
  encoded.resize(size);
  return WriteFileAtomically(path, encoded);
}

}  // namespace lumifold
