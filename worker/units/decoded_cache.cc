#include "worker/units/decoded_cache.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "filter/image/picture_io.h"
#include "filter/image/studio.h"
#include "proto/rpc/sha256.h"
#include "worker/render/lights/studio.h"
#include "worker/scene/images/decode_image.h"

namespace lumifold::worker {
namespace {

using SharedEnvironment = std::shared_ptr<const render::Environment>;

uint64_t BytesOf(const scene::ImageData& image) { return image.bytes(); }

absl::StatusOr<SharedEnvironment> DecodeEnvironment(const v1::EnvironmentMap& environment,
                                                    const std::string& file) {
  const std::string name(absl::StripPrefix(environment.uri(), "environment:"));
  absl::StatusOr<LayeredImage> picture = DecodeLinearPicture(name, file);
  if (!picture.ok()) return picture.status();
  absl::StatusOr<SharedEnvironment> sky =
      render::Environment::Create(*picture, environment.rotate_degrees(), environment.scale());
  if (!sky.ok()) return absl::Status(sky.status().code(), absl::StrCat(name, ": ", sky.status().message()));
  return sky;
}

}  // namespace

absl::StatusOr<scene::SharedImage> DecodedCache::Texture(std::string_view file, int64_t max_pixels) {
  const auto decode = [&]() -> absl::StatusOr<scene::SharedImage> {
    absl::StatusOr<scene::ImageData> image = scene::DecodeImage(file, max_pixels);
    if (!image.ok()) return image.status();
    return std::make_shared<const scene::ImageData>(*std::move(image));
  };
  absl::StatusOr<scene::SharedImage> image = textures_.Get(rpc::Sha256Hex(file), decode, BytesOf);
  if (!image.ok()) return image;
  // A scene has a limit on the pixels of all its textures: one that is kept counts too.
  const bool fits = int64_t{(*image)->width} * (*image)->height <= max_pixels;
  return fits ? image : decode();
}

render::SharedMips DecodedCache::Mips(const scene::SharedImage& image, bool srgb) {
  const auto make = [&]() -> absl::StatusOr<std::shared_ptr<const MipsOf>> {
    return std::make_shared<const MipsOf>(MipsOf{image, render::MakeMips(*image, srgb)});
  };
  const auto bytes_of = [](const MipsOf& mips) {
    uint64_t bytes = 0;
    for (const scene::ImageData& level : mips.levels) bytes += BytesOf(level);
    return bytes;
  };
  const std::string key =
      absl::StrCat(absl::Hex(reinterpret_cast<uintptr_t>(image.get())), srgb ? " srgb" : "");
  const std::shared_ptr<const MipsOf> mips = *mips_.Get(key, make, bytes_of);
  return {mips, &mips->levels};  // keeps the entry in use, and with it the picture's address
}

absl::StatusOr<SharedEnvironment> DecodedCache::Environment(
    const v1::EnvironmentMap& environment, const std::string& sha256,
    const std::function<absl::StatusOr<std::string>(const std::string& uri)>& read) {
  const auto decode = [&]() -> absl::StatusOr<SharedEnvironment> {
    if (environment.uri() == kStudioUri) {
      return render::Environment::Create(render::StudioPicture(), environment.rotate_degrees(),
                                         environment.scale());
    }
    const absl::StatusOr<std::string> file = read(environment.uri());
    if (!file.ok()) return file.status();
    return DecodeEnvironment(environment, *file);
  };
  // The numbers exactly: two that print alike would give one another's sky.
  const std::string key =
      absl::StrFormat("%s %a %a", environment.uri() == kStudioUri ? environment.uri() : sha256,
                      environment.rotate_degrees(), environment.scale());
  return environments_.Get(key, decode, [](const render::Environment& sky) { return sky.bytes(); });
}

void DecodedCache::Drop() {
  textures_.Drop();
  mips_.Drop();
  environments_.Drop();
}

}  // namespace lumifold::worker
