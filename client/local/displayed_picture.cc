#include "client/local/displayed_picture.h"

#include <cstdint>
#include <limits>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/color.h"
#include "filter/image/file_io.h"
#include "worker/scene/images/decode_image.h"

namespace lumifold::local {
namespace {

constexpr int64_t kMaxPixels = int64_t{1} << 28;  // as of OpenEXR
constexpr int64_t kMaxBytes = int64_t{1} << 31;

/// Adds R, G and B, linear.
template <typename Code>
void Spread(const scene::ImageData& picture, LayeredImage* image) {
  constexpr size_t kCodes = size_t{std::numeric_limits<Code>::max()} + 1;
  std::vector<float> linear(kCodes);
  for (size_t i = 0; i < kCodes; ++i)
    linear[i] = LinearFromSrgb(static_cast<float>(i) / static_cast<float>(kCodes - 1));
  const char* const names[] = {"R", "G", "B"};
  for (size_t c = 0; c < 3; ++c) {
    const FloatView plane = image->Add(names[c]);
    const Code* code = picture.codes<Code>().data() + c;
    for (int y = 0; y < plane.height(); ++y) {
      for (int x = 0; x < plane.width(); ++x, code += 4) plane.At(x, y) = linear[*code];
    }
  }
}

}  // namespace

absl::StatusOr<LayeredImage> ReadDisplayed(const std::string& path) {
  const absl::StatusOr<std::string> file = ReadFile(path, kMaxBytes);
  if (!file.ok()) return file.status();
  const absl::StatusOr<scene::ImageData> picture = scene::DecodeImage(*file, kMaxPixels);
  if (!picture.ok()) return absl::DataLossError(absl::StrCat(path, ": ", picture.status().message()));
  LayeredImage image(picture->width, picture->height);
  if (picture->is_deep())
    Spread<uint16_t>(*picture, &image);
  else
    Spread<uint8_t>(*picture, &image);
  return image;
}

}  // namespace lumifold::local
