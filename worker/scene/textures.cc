#include "worker/scene/textures.h"

#include <atomic>
#include <exception>
#include <limits>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "worker/scene/fields.h"
#include "worker/scene/images/decode_image.h"
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

/// The image of a texture: that of an extension where there is one.
int SourceOf(const tinygltf::Texture& texture) {
  for (const char* name : {"KHR_texture_basisu", "EXT_texture_webp"}) {
    const tinygltf::Value* const extension = FindExtension(texture.extensions, name);
    if (extension != nullptr && extension->Has("source") && extension->Get("source").IsInt())
      return extension->Get("source").Get<int>();
  }
  return texture.source;
}

template <typename Code>
void MakeRoughness(float glossiness, std::vector<Code>* codes) {
  constexpr Code kMost = std::numeric_limits<Code>::max();
  for (size_t i = 0; i < codes->size(); i += 4) {
    const float glossy = glossiness * static_cast<float>((*codes)[i + 3]);
    (*codes)[i] = (*codes)[i + 2] = 0;
    (*codes)[i + 1] = static_cast<Code>(float{kMost} + 0.5f - glossy);
    (*codes)[i + 3] = kMost;
  }
}

/// A metallic-roughness picture of a dielectric of that glossiness times the picture's alpha.
ImageData Roughness(const ImageData& image, float glossiness) {
  ImageData made = image;
  MakeRoughness(glossiness, &made.rgba);
  MakeRoughness(glossiness, &made.rgba16);
  return made;
}

/// A task's result, or the exception that it ended with.
struct Decoded {
  absl::StatusOr<SharedImage> image = absl::InternalError("not decoded");
  std::exception_ptr thrown;
};

}  // namespace

TextureTable::TextureTable(const Document& document, const LoadOptions& options, Scene* scene,
                           Diagnostics* diagnostics)
    : document_(document),
      options_(options),
      scene_(scene),
      diagnostics_(diagnostics),
      textures_(document.model.textures.size(), kNotRead),
      images_(document.images.size(), kNotRead) {}

absl::StatusOr<int> TextureTable::Use(int index) {
  if (index < 0 || static_cast<size_t>(index) >= textures_.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("texture ", index, " does not exist (there are ", textures_.size(), ")"));
  }
  if (textures_[index] != kNotRead) return textures_[index];
  const tinygltf::Texture& texture_source = document_.model.textures[index];
  const std::string place = Place("texture", index, texture_source.name);
  const int source = SourceOf(texture_source);
  if (source == kNone) {
    diagnostics_->Count("textures without a picture that is read left out", place);
    return textures_[index] = kNone;
  }
  Texture texture;
  if (auto s = ApplySampler(document_.model, texture_source.sampler, &texture); !s.ok())
    return WithContext(s, place);
  const auto image = UseImage(source);
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
  images_[index] = static_cast<int>(sources_.size());
  sources_.push_back({index, std::nullopt});
  return images_[index];
}

int TextureTable::RoughnessOfGlossiness(int texture, float glossiness) {
  Texture made = scene_->textures[texture];
  sources_.push_back({sources_[made.image].image, glossiness});
  made.image = static_cast<int>(sources_.size()) - 1;
  scene_->textures.push_back(made);
  return static_cast<int>(scene_->textures.size()) - 1;
}

absl::Status TextureTable::DecodeImages(const AssetReader& reader) {
  absl::Mutex reading;
  const AssetReader one_at_a_time = [&](const std::string& uri) {
    absl::MutexLock lock(&reading);
    return reader(uri);
  };
  std::vector<Decoded> decoded(sources_.size());
  std::atomic<int64_t> pixels = 0;
  const int64_t limit = options_.limits.max_texture_pixels;
  ParallelFor(options_.pool, static_cast<int64_t>(sources_.size()), [&](int64_t i) {
    if (pixels > limit) return;  // the load fails: no more memory for it
    try {
      decoded[i].image = Decode(sources_[i], one_at_a_time);
      if (decoded[i].image.ok()) pixels += int64_t{(*decoded[i].image)->width} * (*decoded[i].image)->height;
    } catch (...) {  // of a library or for want of memory; tasks must not throw
      decoded[i].thrown = std::current_exception();
    }
  });
  if (pixels > limit) {
    return absl::ResourceExhaustedError(
        absl::StrCat("its textures have more pixels together than the limit of ", limit));
  }
  for (size_t i = 0; i < decoded.size(); ++i) {
    if (decoded[i].thrown != nullptr) std::rethrow_exception(decoded[i].thrown);
    if (!decoded[i].image.ok()) {
      const int image = sources_[i].image;
      return WithContext(decoded[i].image.status(), Place("image", image, document_.images[image].name));
    }
    scene_->images.push_back(*std::move(decoded[i].image));
  }
  return absl::OkStatus();
}

absl::StatusOr<SharedImage> TextureTable::Decode(const Source& source,
                                                 const AssetReader& one_at_a_time) const {
  auto image = DecodeSource(document_.images[source.image], one_at_a_time);
  if (!image.ok() || !source.glossiness.has_value()) return image;
  return std::make_shared<const ImageData>(Roughness(**image, *source.glossiness));
}

absl::StatusOr<SharedImage> TextureTable::DecodeSource(const ImageSource& source,
                                                       const AssetReader& one_at_a_time) const {
  if (source.view != kNone) {
    const auto bytes = ViewBytes(document_, source.view);
    if (!bytes.ok()) return bytes.status();
    return DecodeFile(*bytes);
  }
  const auto bytes = ReadUri(source.uri, one_at_a_time);
  if (!bytes.ok()) return bytes.status();
  auto image = DecodeFile(*bytes);
  if (!image.ok() && !IsDataUri(source.uri)) return WithContext(image.status(), source.uri);
  return image;
}

absl::StatusOr<SharedImage> TextureTable::DecodeFile(std::string_view file) const {
  const int64_t limit = options_.limits.max_texture_pixels;
  if (options_.decode) return options_.decode(file, limit);
  absl::StatusOr<ImageData> image = DecodeImage(file, limit);
  if (!image.ok()) return image.status();
  return std::make_shared<const ImageData>(*std::move(image));
}

}  // namespace lumifold::scene
