#include "worker/render/textures/texture.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace lumifold::render {
namespace {

using scene::ImageData;
using scene::Vec2;
using scene::Vec3;
using scene::Vec4;

/// Maximum number of probes; longer footprints are blurred across instead.
constexpr int kMaxProbes = 8;

/// Red, green, blue and alpha, in one register.
using Rgba [[gnu::vector_size(4 * sizeof(float))]] = float;

Vec4 ToVec4(Rgba v) { return {v[0], v[1], v[2], v[3]}; }

int WrapTexel(int i, int size, scene::Wrap wrap) {
  if (i >= 0 && i < size) return i;  // nearly always, and spares a division
  if (wrap == scene::Wrap::kClamp) return std::clamp(i, 0, size - 1);
  const int period = wrap == scene::Wrap::kMirror ? 2 * size : size;
  const bool is_power = (period & (period - 1)) == 0;
  i = is_power ? i & (period - 1) : i % period;
  if (i < 0) i += period;
  return i < size ? i : period - 1 - i;
}

/// Bounds a texture coordinate so that it fits an int; larger floats have no fraction anyway.
float BoundCoordinate(float x) { return std::clamp(x, -1e8f, 1e8f); }

/// The greatest integer not above x, which BoundCoordinate() has bounded.
int FloorToInt(float x) {
  const int towards_zero = static_cast<int>(x);
  return towards_zero - (static_cast<float>(towards_zero) > x ? 1 : 0);
}

template <typename T>
T Mix(T a, T b, float t) {
  return a + (b - a) * t;
}

Vec2 Linear(const scene::TextureRef& ref, Vec2 v) {
  return {ref.row_u.x * v.x + ref.row_u.y * v.y, ref.row_v.x * v.x + ref.row_v.y * v.y};
}

Vec2 Transform(const scene::TextureRef& ref, Vec2 uv) { return Linear(ref, uv) + ref.offset; }

/// The two texels of a row or column around a coordinate, and its distance from the first one's centre.
struct Neighbours {
  int first;
  int second;
  float distance;

  Neighbours(float coordinate, int size, scene::Wrap wrap) {
    const float x = BoundCoordinate(coordinate * static_cast<float>(size)) - 0.5f;
    const int left = FloorToInt(x);
    first = WrapTexel(left, size, wrap);
    second =
        wrap == scene::Wrap::kRepeat ? (first + 1 < size ? first + 1 : 0) : WrapTexel(left + 1, size, wrap);
    distance = x - static_cast<float>(left);
  }
};

/// The value of a picture at uv; texel(x, y) returns the value of one texel.
template <typename T, typename Texel>
T Interpolate(const ImageData& image, const scene::Texture& texture, Vec2 uv, const Texel& texel) {
  if (texture.nearest) {
    const auto nearest = [](float coordinate, int size, scene::Wrap wrap) {
      return WrapTexel(FloorToInt(BoundCoordinate(coordinate * static_cast<float>(size))), size, wrap);
    };
    return texel(nearest(uv.x, image.width, texture.wrap_s), nearest(uv.y, image.height, texture.wrap_t));
  }
  const Neighbours x(uv.x, image.width, texture.wrap_s);
  const Neighbours y(uv.y, image.height, texture.wrap_t);
  return Mix(Mix(texel(x.first, y.first), texel(x.second, y.first), x.distance),
             Mix(texel(x.first, y.second), texel(x.second, y.second), x.distance), y.distance);
}

/// The linear values of a picture's texels, which have codes of this type. `color` decodes red, green and
/// blue, and alpha is not read; null: the codes are linear.
template <typename Code>
struct Texels {
  const ImageData* image;
  const TransferTable* color;

  Rgba operator()(int x, int y) const {
    using Codes [[gnu::vector_size(4 * sizeof(Code))]] = Code;
    Codes codes;
    std::memcpy(&codes, &image->codes<Code>()[(static_cast<size_t>(y) * image->width + x) * 4],
                sizeof(codes));
    if (color == nullptr)
      return __builtin_convertvector(codes, Rgba) / static_cast<float>(std::numeric_limits<Code>::max());
    return Rgba{color->Decode(codes[0]), color->Decode(codes[1]), color->Decode(codes[2]), 1};
  }
};

template <typename Code>
Rgba Bilinear(const Texels<Code>& texels, const scene::Texture& texture, Vec2 uv) {
  return Interpolate<Rgba>(*texels.image, texture, uv, texels);
}

/// Interpolates between the two levels whose texels are nearest in size to `width` texels of the picture; at
/// most the smallest level.
template <typename Code>
class Trilinear {
 public:
  Trilinear(const Texels<Code>& picture, const MipLevels& levels, float width)
      : fine_(picture), coarse_(picture) {
    int level = 0;  // the last one whose texels are not wider than `width`
    for (float next = 2; next <= width && level < static_cast<int>(levels.size()); next *= 2) ++level;
    if (level > 0) fine_.image = &levels[level - 1];
    if (level == static_cast<int>(levels.size())) return;
    excess_ = width / static_cast<float>(1 << level) - 1.0f;
    coarse_.image = &levels[level];
  }

  Rgba At(const scene::Texture& texture, Vec2 uv) const {
    const Rgba fine = Bilinear(fine_, texture, uv);
    return excess_ > 0 ? Mix(fine, Bilinear(coarse_, texture, uv), excess_) : fine;
  }

 private:
  Texels<Code> fine_;
  Texels<Code> coarse_;
  float excess_ = 0;
};

/// The mean over a footprint, whose first texture coordinates are at `ref`'s set.
template <typename Code>
Vec4 MeanOver(const Texels<Code>& texels, const MipLevels& levels, const scene::Texture& texture,
              const scene::TextureRef& ref, Vec2 uv, const Vec2 (&diameter)[2]) {
  const ImageData& image = *texels.image;
  const Vec2 center = Transform(ref, uv);
  const auto texels2 = [&image](Vec2 v) {
    const float x = v.x * static_cast<float>(image.width);
    const float y = v.y * static_cast<float>(image.height);
    return x * x + y * y;
  };
  Vec2 major = Linear(ref, diameter[0]);
  float major2 = texels2(major);
  float minor2 = texels2(Linear(ref, diameter[1]));
  if (minor2 > major2) {
    major = Linear(ref, diameter[1]);
    std::swap(major2, minor2);
  }
  if (!(major2 > 1)) return ToVec4(Bilinear(texels, texture, center));

  const float length = std::min(std::sqrt(major2), 1e9f);
  const float width = std::max(std::sqrt(minor2), std::max(length / kMaxProbes, 1.0f));
  const int probes = std::max(static_cast<int>(std::ceil(length / width)), 1);
  const Trilinear<Code> trilinear(texels, levels, width);
  Rgba sum = {};
  for (int i = 0; i < probes; ++i) {
    const float along = (static_cast<float>(i) + 0.5f) / static_cast<float>(probes) - 0.5f;
    sum += trilinear.At(texture, center + major * along);
  }
  return ToVec4(sum * (1.0f / static_cast<float>(probes)));
}

template <typename Code>
Vec3 MeanOfAll(const Texels<Code>& texels) {
  const ImageData& image = *texels.image;
  double sum[3] = {0, 0, 0};
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const Rgba texel = texels(x, y);
      for (int c = 0; c < 3; ++c) sum[c] += static_cast<double>(texel[c]);
    }
  }
  const double count = static_cast<double>(image.width) * image.height;
  return {static_cast<float>(sum[0] / count), static_cast<float>(sum[1] / count),
          static_cast<float>(sum[2] / count)};
}

}  // namespace

TextureSampler::TextureSampler(const scene::Scene& scene, const MipSource& mips)
    : scene_(&scene), srgb_(/*srgb=*/true) {
  for (auto& levels : levels_) levels.resize(scene.images.size());
  for (const scene::Material& material : scene.materials) {
    for (const scene::TextureUse& use : TexturesOf(material)) Prepare(use, mips);
  }
}

void TextureSampler::Prepare(const scene::TextureUse& use, const MipSource& mips) {
  if (use.ref->texture == scene::kNone) return;
  const int image = scene_->textures[use.ref->texture].image;
  if (image == scene::kNone) return;
  SharedMips& levels = levels_[use.srgb][image];
  if (levels != nullptr) return;
  const scene::SharedImage& picture = scene_->images[image];
  levels = mips ? mips(picture, use.srgb) : std::make_shared<const MipLevels>(MakeMips(*picture, use.srgb));
}

Vec4 TextureSampler::SampleImage(const scene::TextureRef& ref, const Vec2 uv[2], const Footprint& footprint,
                                 bool srgb) const {
  const scene::Texture& texture = scene_->textures[ref.texture];
  if (texture.image == scene::kNone) return {1, 1, 1, 1};
  const ImageData& image = *scene_->images[texture.image];
  const TransferTable* color = srgb ? &srgb_ : nullptr;
  const MipLevels& levels = *levels_[srgb][texture.image];
  const Vec2 at = uv[ref.uv_set];
  const auto& diameter = footprint.diameter[ref.uv_set];
  if (image.is_deep()) return MeanOver<uint16_t>({&image, color}, levels, texture, ref, at, diameter);
  return MeanOver<uint8_t>({&image, color}, levels, texture, ref, at, diameter);
}

Vec3 TextureSampler::Mean(const scene::TextureRef& ref, bool srgb) const {
  if (ref.texture == scene::kNone || scene_->textures[ref.texture].image == scene::kNone) return {1, 1, 1};
  const ImageData& image = *scene_->images[scene_->textures[ref.texture].image];
  const TransferTable* color = srgb ? &srgb_ : nullptr;
  return image.is_deep() ? MeanOfAll<uint16_t>({&image, color}) : MeanOfAll<uint8_t>({&image, color});
}

float SampleAlpha(const scene::Scene& scene, const scene::TextureRef& ref, Vec2 uv) {
  const scene::Texture& texture = scene.textures[ref.texture];
  if (texture.image == scene::kNone) return 1;
  const ImageData& image = *scene.images[texture.image];
  return Interpolate<float>(image, texture, Transform(ref, uv), [&image](int x, int y) {
    const size_t code = (static_cast<size_t>(y) * image.width + x) * 4 + 3;
    if (image.is_deep()) return static_cast<float>(image.rgba16[code]) / 65535.0f;
    return static_cast<float>(image.rgba[code]) / 255.0f;
  });
}

}  // namespace lumifold::render
