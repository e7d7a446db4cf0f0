#include "tests/scenes/png_writer.h"

#include <png.h>

#include <cstddef>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace lumifold::scenes {

absl::StatusOr<std::string> EncodePng(const Texture& texture) {
  const std::size_t bytes = std::size_t{3} * texture.width * texture.height;
  if (texture.width <= 0 || texture.height <= 0 || texture.rgb.size() != bytes) {
    return absl::InvalidArgumentError(absl::StrCat("texture ", texture.name, ": ", texture.rgb.size(),
                                                   " bytes do not make ", texture.width, "x", texture.height,
                                                   " RGB pixels"));
  }
  png_image image = {};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(texture.width);
  image.height = static_cast<png_uint_32>(texture.height);
  image.format = PNG_FORMAT_RGB;
  std::string file(PNG_IMAGE_PNG_SIZE_MAX(image), '\0');
  png_alloc_size_t size = file.size();
  if (png_image_write_to_memory(&image, file.data(), &size, 0, texture.rgb.data(), 0, nullptr) == 0) {
    return absl::InternalError(absl::StrCat("texture ", texture.name, ": ", image.message));
  }
  file.resize(size);
  return file;
}

}  // namespace lumifold::scenes
