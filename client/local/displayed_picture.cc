#include "client/local/displayed_picture.h"

#include <array>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "filter/image/color.h"
#include "filter/image/file_io.h"
#include "worker/scene/images/decode_image.h"

namespace lumifold::local {
namespace {

constexpr int64_t kMaxPixels = int64_t{1} << 28;  // as of OpenEXR
constexpr int64_t kMaxBytes = int64_t{1} << 31;

}  // namespace

absl::StatusOr<LayeredImage> ReadDisplayed(const std::string& path) {
  const absl::StatusOr<std::string> file = ReadFile(path, kMaxBytes);
  if (!file.ok()) return file.status();
  const absl::StatusOr<scene::ImageData> picture = scene::DecodeImage(*file, kMaxPixels);
  if (!picture.ok()) return absl::DataLossError(absl::StrCat(path, ": ", picture.status().message()));
  std::array<float, 256> linear{};
  for (size_t i = 0; i < linear.size(); ++i) linear[i] = LinearFromSrgb(static_cast<float>(i) / 255);
  LayeredImage image(picture->width, picture->height);
  const char* const names[] = {"R", "G", "B"};
  for (size_t c = 0; c < 3; ++c) {
    const FloatView plane = image.Add(names[c]);
    const uint8_t* byte = picture->rgba.data() + c;
    for (int y = 0; y < plane.height(); ++y) {
      for (int x = 0; x < plane.width(); ++x, byte += 4) plane.At(x, y) = linear[*byte];
    }
  }
  return image;
}

}  // namespace lumifold::local
