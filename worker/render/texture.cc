#include "worker/render/texture.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lumifold::render {
namespace {

using scene::ImageData;
using scene::Vec2;
using scene::Vec3;
using scene::Vec4;

/// Maximum number of probes; longer footprints are blurred across instead.
constexpr int kMaxProbes = 8;

int WrapTexel(int i, int size, scene::Wrap wrap) {
  if (wrap == scene::Wrap::kClamp) return std::clamp(i, 0, size - 1);
  const int period = wrap == scene::Wrap::kMirror ? 2 * size : size;
  i %= period;
  if (i < 0) i += period;
  return i < size ? i : period - 1 - i;
}

/// Bounds a texture coordinate so that it fits an int; larger floats have no fraction anyway.
float BoundCoordinate(float x) { return std::clamp(x, -1e8f, 1e8f); }

Vec4 Mix(const Vec4& a, const Vec4& b, float t) {
  return {a.x + (b.x - a.x) * t, a.y + (b.y - a.y) * t, a.z + (b.z - a.z) * t, a.w + (b.w - a.w) * t};
}

float Mix(float a, float b, float t) { return a + (b - a) * t; }

Vec2 Linear(const scene::TextureRef& ref, Vec2 v) {
  return {ref.row_u.x * v.x + ref.row_u.y * v.y, ref.row_v.x * v.x + ref.row_v.y * v.y};
}

Vec2 Transform(const scene::TextureRef& ref, Vec2 uv) { return Linear(ref, uv) + ref.offset; }

/// The value of a picture at uv; texel(x, y) returns the value of one texel.
template <typename T, typename Texel>
T Interpolate(const ImageData& image, const scene::Texture& texture, Vec2 uv, const Texel& texel) {
  const float x = BoundCoordinate(uv.x * static_cast<float>(image.width));
  const float y = BoundCoordinate(uv.y * static_cast<float>(image.height));
  if (texture.nearest) {
    return texel(WrapTexel(static_cast<int>(std::floor(x)), image.width, texture.wrap_s),
                 WrapTexel(static_cast<int>(std::floor(y)), image.height, texture.wrap_t));
  }
  const float left = std::floor(x - 0.5f);
  const float top = std::floor(y - 0.5f);
  const int x0 = WrapTexel(static_cast<int>(left), image.width, texture.wrap_s);
  const int x1 = WrapTexel(static_cast<int>(left) + 1, image.width, texture.wrap_s);
  const int y0 = WrapTexel(static_cast<int>(top), image.height, texture.wrap_t);
  const int y1 = WrapTexel(static_cast<int>(top) + 1, image.height, texture.wrap_t);
  const float tx = x - 0.5f - left;
  const float ty = y - 0.5f - top;
  return Mix(Mix(texel(x0, y0), texel(x1, y0), tx), Mix(texel(x0, y1), texel(x1, y1), tx), ty);
}

}  // namespace

TextureSampler::TextureSampler(const scene::Scene& scene, const MipSource& mips)
    : scene_(&scene), linear_(/*srgb=*/false), srgb_(/*srgb=*/true) {
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

Vec4 TextureSampler::Texel(const ImageData& image, int x, int y, bool srgb) const {
  const uint8_t* p = &image.rgba[(static_cast<size_t>(y) * image.width + x) * 4];
  const TransferTable& color = srgb ? srgb_ : linear_;
  return {color.Decode(p[0]), color.Decode(p[1]), color.Decode(p[2]), linear_.Decode(p[3])};
}

Vec4 TextureSampler::Bilinear(const ImageData& image, const scene::Texture& texture, Vec2 uv,
                              bool srgb) const {
  return Interpolate<Vec4>(image, texture, uv, [&](int x, int y) { return Texel(image, x, y, srgb); });
}

Vec4 TextureSampler::SampleImage(const scene::TextureRef& ref, const Vec2 uv[2], const Footprint& footprint,
                                 bool srgb) const {
  const scene::Texture& texture = scene_->textures[ref.texture];
  if (texture.image == scene::kNone) return {1, 1, 1, 1};
  const ImageData& image = *scene_->images[texture.image];
  const Vec2 center = Transform(ref, uv[ref.uv_set]);
  const auto texels2 = [&image](Vec2 v) {
    const float x = v.x * static_cast<float>(image.width);
    const float y = v.y * static_cast<float>(image.height);
    return x * x + y * y;
  };
  Vec2 major = Linear(ref, footprint.diameter[ref.uv_set][0]);
  float major2 = texels2(major);
  float minor2 = texels2(Linear(ref, footprint.diameter[ref.uv_set][1]));
  if (minor2 > major2) {
    major = Linear(ref, footprint.diameter[ref.uv_set][1]);
    std::swap(major2, minor2);
  }
  if (!(major2 > 1)) return Bilinear(image, texture, center, srgb);

  const float length = std::min(std::sqrt(major2), 1e9f);
  const float width = std::max(std::sqrt(minor2), std::max(length / kMaxProbes, 1.0f));
  const int probes = std::max(static_cast<int>(std::ceil(length / width)), 1);
  Vec4 sum;
  for (int i = 0; i < probes; ++i) {
    const float along = (static_cast<float>(i) + 0.5f) / static_cast<float>(probes) - 0.5f;
    const Vec4 probe = SampleLevels(texture, center + major * along, width, srgb);
    sum = {sum.x + probe.x, sum.y + probe.y, sum.z + probe.z, sum.w + probe.w};
  }
  const float share = 1.0f / static_cast<float>(probes);
  return {sum.x * share, sum.y * share, sum.z * share, sum.w * share};
}

Vec4 TextureSampler::SampleLevels(const scene::Texture& texture, Vec2 uv, float width, bool srgb) const {
  const ImageData& image = *scene_->images[texture.image];
  const MipLevels& levels = *levels_[srgb][texture.image];
  int level = 0;  // the last one whose texels are not wider than `width`
  for (float next = 2; next <= width && level < static_cast<int>(levels.size()); next *= 2) ++level;
  const ImageData& finer = level == 0 ? image : levels[level - 1];
  const Vec4 fine = Bilinear(finer, texture, uv, srgb);
  if (level == static_cast<int>(levels.size())) return fine;
  const float excess = width / static_cast<float>(1 << level) - 1.0f;
  return excess > 0 ? Mix(fine, Bilinear(levels[level], texture, uv, srgb), excess) : fine;
}

Vec3 TextureSampler::Mean(const scene::TextureRef& ref, bool srgb) const {
  if (ref.texture == scene::kNone || scene_->textures[ref.texture].image == scene::kNone) return {1, 1, 1};
  const ImageData& image = *scene_->images[scene_->textures[ref.texture].image];
  double sum[3] = {0, 0, 0};
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const Vec4 t = Texel(image, x, y, srgb);
      sum[0] += static_cast<double>(t.x);
      sum[1] += static_cast<double>(t.y);
      sum[2] += static_cast<double>(t.z);
    }
  }
  const double count = static_cast<double>(image.width) * image.height;
  return {static_cast<float>(sum[0] / count), static_cast<float>(sum[1] / count),
          static_cast<float>(sum[2] / count)};
}

float SampleAlpha(const scene::Scene& scene, const scene::TextureRef& ref, Vec2 uv) {
  const scene::Texture& texture = scene.textures[ref.texture];
  if (texture.image == scene::kNone) return 1;
  const ImageData& image = *scene.images[texture.image];
  return Interpolate<float>(image, texture, Transform(ref, uv), [&image](int x, int y) {
    return static_cast<float>(image.rgba[(static_cast<size_t>(y) * image.width + x) * 4 + 3]) / 255.0f;
  });
}

}  // namespace lumifold::render
