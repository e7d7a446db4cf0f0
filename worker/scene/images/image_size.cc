#include "worker/scene/images/image_size.h"

#include "absl/strings/str_cat.h"

namespace lumifold::scene {

absl::Status CheckImageSize(uint64_t width, uint64_t height, int64_t max_pixels) {
  constexpr uint64_t kMaxSide = 1u << 20;
  if (width == 0 || height == 0) return absl::InvalidArgumentError("a picture without pixels");
  const bool fits =
      width <= kMaxSide && height <= kMaxSide && static_cast<int64_t>(width * height) <= max_pixels;
  if (fits) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat(width, "x", height, " pixels are over the limit of ", max_pixels));
}

absl::Status CheckImageBytes(uint64_t width, uint64_t height, int64_t pixels_per_byte, int64_t bytes) {
  if (static_cast<int64_t>(width * height) / pixels_per_byte <= bytes) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("claims ", width, "x", height, " pixels, but has only ", bytes, " bytes"));
}

ImageData EmptyImage(uint64_t width, uint64_t height, bool is_deep) {
  ImageData image;
  image.width = static_cast<int>(width);
  image.height = static_cast<int>(height);
  const size_t codes = static_cast<size_t>(width * height) * 4;
  if (is_deep)
    image.rgba16.resize(codes);
  else
    image.rgba.resize(codes);
  return image;
}

}  // namespace lumifold::scene
