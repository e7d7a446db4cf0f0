#include "worker/scene/textures.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/scene/images.h"
#include "worker/scene/uri.h"

namespace lumifold::scene {
namespace {

constexpr int kNotRead = -2;

absl::StatusOr<Wrap> WrapFrom(int code) {
  switch (code) {
    case TINYGLTF_TEXTURE_WRAP_REPEAT:
      return Wrap::kRepeat;
    case TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT:
      return Wrap::kMirror;
    case TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE:
      return Wrap::kClamp;
    default:
      return absl::InvalidArgumentError(absl::StrCat("wrap mode ", code, " is not glTF's"));
  }
}

absl::Status ApplySampler(const tinygltf::Model& model, int sampler, Texture* texture) {
  if (sampler == kNone) return absl::OkStatus();
  if (sampler < 0 || static_cast<size_t>(sampler) >= model.samplers.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("sampler ", sampler, " does not exist (there are ", model.samplers.size(), ")"));
  }
  const tinygltf::Sampler& s = model.samplers[sampler];
  const auto wrap_s = WrapFrom(s.wrapS), wrap_t = WrapFrom(s.wrapT);
  if (!wrap_s.ok()) return wrap_s.status();
  if (!wrap_t.ok()) return wrap_t.status();
  texture->wrap_s = *wrap_s;
  texture->wrap_t = *wrap_t;
  texture->nearest = s.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
  return absl::OkStatus();
}

}  // namespace

TextureTable::TextureTable(const Document& document, const AssetReader& reader, const LoadOptions& options,
                           Scene* scene, Diagnostics* diagnostics)
    : document_(document),
      reader_(reader),
      decode_(options.decode),
      scene_(scene),
      diagnostics_(diagnostics),
      pixels_left_(options.limits.max_texture_pixels),
      textures_(document.model.textures.size(), kNotRead),
      images_(document.images.size(), kNotRead) {}

absl::StatusOr<int> TextureTable::Use(int index) {
  if (index < 0 || static_cast<size_t>(index) >= textures_.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("texture ", index, " does not exist (there are ", textures_.size(), ")"));
  }
  if (textures_[index] != kNotRead) return textures_[index];
  const tinygltf::Texture& source = document_.model.textures[index];
  const std::string place = Place("texture", index, source.name);
  if (source.source == kNone) {
    diagnostics_->Count("textures without a PNG or JPEG picture left out", place);
    return textures_[index] = kNone;
  }
  Texture texture;
  if (auto s = ApplySampler(document_.model, source.sampler, &texture); !s.ok()) return WithContext(s, place);
  const auto image = UseImage(source.source);
  if (!image.ok()) return WithContext(image.status(), place);
  texture.image = *image;
  textures_[index] = static_cast<int>(scene_->textures.size());
  scene_->textures.push_back(texture);
  return textures_[index];
}

absl::StatusOr<int> TextureTable::UseImage(int index) {
  if (index < 0 || static_cast<size_t>(index) >= images_.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("image ", index, " does not exist (there are ", images_.size(), ")"));
  }
  if (images_[index] != kNotRead) return images_[index];
  const ImageSource& source = document_.images[index];
  auto image = Decode(source);
  if (!image.ok()) return WithContext(image.status(), Place("image", index, source.name));
  pixels_left_ -= int64_t{(*image)->width} * (*image)->height;
  images_[index] = static_cast<int>(scene_->images.size());
  scene_->images.push_back(*std::move(image));
  return images_[index];
}

absl::StatusOr<SharedImage> TextureTable::Decode(const ImageSource& source) {
  if (source.view != kNone) {
    const auto bytes = ViewBytes(document_, source.view);
    if (!bytes.ok()) return bytes.status();
    return DecodeFile(*bytes);
  }
  const auto bytes = ReadUri(source.uri, reader_);
  if (!bytes.ok()) return bytes.status();
  auto image = DecodeFile(*bytes);
  if (!image.ok() && !IsDataUri(source.uri)) return WithContext(image.status(), source.uri);
  return image;
}

absl::StatusOr<SharedImage> TextureTable::DecodeFile(std::string_view file) const {
  if (decode_) return decode_(file, pixels_left_);
  absl::StatusOr<ImageData> image = DecodeImage(file, pixels_left_);
  if (!image.ok()) return image.status();
  return std::make_shared<const ImageData>(*std::move(image));
}

}  // namespace lumifold::scene
