// Pictures from outside: PNG, JPEG and KTX2 textures (the last from the corpus), OpenEXR and Radiance
// environment maps. For any bytes, decoding gives a picture within the limits or an error of one line.

#include <algorithm>

#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "filter/image/picture_io.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/gltf_fixture.h"
#include "tests/support/temp_folder.h"
#include "worker/scene/images/decode_image.h"

namespace lumifold::fuzz {
namespace {

constexpr int64_t kMaxTexels = 1 << 20;

void CheckError(const absl::Status& status) {
  const std::string text(status.message());
  if (text.empty() || text.size() > 1000) Fail("an error without text, or a very long one", text);
}

std::string SmallExr(int channels, bool with_lists) {
  const TempFolder folder(InMemory());
  EdgedImage image{LayeredImage(20, 12)};
  constexpr const char* kNames[] = {"", "noisy", "direct"};
  for (int i = 0; i < channels; ++i) image.pixels.AddColor(kNames[i]);
  for (const FloatView& view : {image.pixels.Get("R")}) view.At(3, 4) = 7;
  image.pixels.metadata()["lumifold:job"] = "j-1";
  if (with_lists) {
    image.edges = LayeredImage(16, 2);
    image.edges.Add("pixel.x");
    image.fragments = LayeredImage(1, 3);
    image.fragments.Add("surface.Y");
  }
  const std::string path = folder.PathOf("a.exr");
  if (!WriteExr(path, image).ok()) Fail("cannot write", path);
  return *ReadFile(path, 1 << 24);
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<uint8_t> samples(24 * 16 * 4);
  for (size_t i = 0; i < samples.size(); ++i) samples[i] = static_cast<uint8_t>(i * i / 7);
  std::vector<std::string> seeds;
  for (const int channels : {1, 2, 3, 4}) {
    const std::vector<uint8_t> part(samples.begin(), samples.begin() + 12 * 16 * channels);
    seeds.push_back(scene::EncodePng(12, 16, channels, 8, channels % 2 == 0, part));
    if (channels != 2) seeds.push_back(scene::EncodeJpeg(12, 16, channels, channels == 3, part));
  }
  seeds.push_back(scene::EncodePng(6, 16, 1, 16, false, {samples.begin(), samples.begin() + 192}));
  for (const int channels : {1, 3}) seeds.push_back(SmallExr(channels, channels == 3));
  const std::string head = "#?RADIANCE\nEXPOSURE=2\nFORMAT=32-bit_rle_rgbe\n\n";
  seeds.push_back(head + "-Y 2 +X 2\n" +
                  std::string("\x80\x40\x20\x81\x01\x01\x01\x01\x80\x40\x20\x81\x10\x20\x30\x80", 16));
  seeds.push_back(head + "+X 1 +Y 10\n" +
                  std::string("\x02\x02\x00\x0a\x8a\x80\x03\x00\x40\x80\x87\x00\x8a\x00\x8a\x81", 16));
  return seeds;
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace lumifold;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const absl::StatusOr<scene::ImageData> texture = scene::DecodeImage(bytes, fuzz::kMaxTexels);
  if (!texture.ok()) {
    fuzz::CheckError(texture.status());
  } else if (const size_t codes = texture->is_deep() ? texture->rgba16.size() : texture->rgba.size();
             int64_t{texture->width} * texture->height > fuzz::kMaxTexels ||
             codes !=
                 size_t{4} * static_cast<size_t>(texture->width) * static_cast<size_t>(texture->height)) {
    fuzz::Fail("a texture of the wrong size", std::to_string(codes));
  }
  const absl::StatusOr<LayeredImage> picture = DecodeLinearPicture("sky", bytes);
  if (!picture.ok()) fuzz::CheckError(picture.status());
  if (picture.ok() && !picture->HasColor("")) fuzz::Fail("a picture without colour", "");
  return 0;
}
