#include "worker/scene/images/webp.h"

#include <webp/decode.h>

#include "worker/scene/images/image_size.h"

namespace lumifold::scene {

bool IsWebp(std::string_view bytes) {
  constexpr size_t kHeaderBytes = 12;
  return bytes.size() >= kHeaderBytes && bytes.starts_with("RIFF") && bytes.substr(8, 4) == "WEBP";
}

absl::StatusOr<ImageData> DecodeWebp(std::string_view bytes, int64_t max_pixels) {
  const auto* data = reinterpret_cast<const uint8_t*>(bytes.data());
  WebPBitstreamFeatures features;
  if (WebPGetFeatures(data, bytes.size(), &features) != VP8_STATUS_OK)
    return absl::InvalidArgumentError("damaged WebP: no header of a picture");
  if (features.has_animation != 0) return absl::InvalidArgumentError("an animated WebP is no texture");
  const auto width = static_cast<uint64_t>(features.width), height = static_cast<uint64_t>(features.height);
  if (auto s = CheckImageSize(width, height, max_pixels); !s.ok()) return s;
  ImageData image = EmptyImage(width, height);
  if (WebPDecodeRGBAInto(data, bytes.size(), image.rgba.data(), image.rgba.size(), 4 * features.width) ==
      nullptr)
    return absl::InvalidArgumentError("damaged WebP: its pixels cannot be read");
  return image;
}

}  // namespace lumifold::scene
