#include "filter/image/png_io.h"

#include <png.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "filter/image/color.h"
#include "filter/image/file_io.h"
#include "filter/image/planes.h"

namespace lumifold {

absl::Status WritePng(const std::string& path, const ConstColorView& linear, float exposure) {
  PngRowWriter writer(path, linear[0].width(), linear[0].height(), exposure);
  writer.Append(linear);
  return writer.Finish();
}

PngRowWriter::PngRowWriter(std::string path, int width, int height, float exposure)
    : path_(std::move(path)), width_(width), height_(height), exposure_(exposure) {
  bytes_.reserve(size_t{3} * static_cast<size_t>(width) * static_cast<size_t>(height));
}

void PngRowWriter::Append(const ConstColorView& linear) {
  ForEachPixel(width_, linear[0].height(), [&](int x, int y) {
    for (const ConstFloatView& channel : linear) {
      const float encoded = SrgbFromLinear(exposure_ * channel.At(x, y));
      bytes_.push_back(static_cast<uint8_t>(255.0f * encoded + 0.5f));
    }
  });
}

absl::Status PngRowWriter::Finish() const {
  if (width_ <= 0 || height_ <= 0) {
    return absl::InvalidArgumentError(absl::StrCat("cannot write ", path_, ": the picture has no pixels"));
  }
  LUMIFOLD_CHECK(bytes_.size() == size_t{3} * static_cast<size_t>(width_) * static_cast<size_t>(height_));
  png_image image = {};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width_);
  image.height = static_cast<png_uint_32>(height_);
  image.format = PNG_FORMAT_RGB;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string encoded(size, '\0');
  if (png_image_write_to_memory(&image, encoded.data(), &size, 0, bytes_.data(), 0, nullptr) == 0) {
    return absl::InternalError(absl::StrCat("cannot encode ", path_, ": ", image.message));
  }
  encoded.resize(size);
  return WriteFileAtomically(path_, encoded);
}

}  // namespace lumifold
