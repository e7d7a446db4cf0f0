#include "worker/render/texture.h"

#include <algorithm>
#include <cmath>

#include "filter/image/color.h"

namespace lumifold::render {
namespace {

using scene::Vec2;
using scene::Vec3;
using scene::Vec4;

int WrapTexel(int i, int size, scene::Wrap wrap) {
  if (wrap == scene::Wrap::kClamp) return std::clamp(i, 0, size - 1);
  const int period = wrap == scene::Wrap::kMirror ? 2 * size : size;
  i %= period;
  if (i < 0) i += period;
  return i < size ? i : period - 1 - i;
}

/// Texture coordinates far outside lose their fraction in float anyway; bounded, they fit an int.
float BoundCoordinate(float x) { return std::clamp(x, -1e8f, 1e8f); }

Vec4 Mix(const Vec4& a, const Vec4& b, float t) {
  return {a.x + (b.x - a.x) * t, a.y + (b.y - a.y) * t, a.z + (b.z - a.z) * t, a.w + (b.w - a.w) * t};
}

}  // namespace

TextureSampler::TextureSampler(const scene::Scene& scene) : scene_(&scene) {
  for (int i = 0; i < 256; ++i) {
    linear_[i] = static_cast<float>(i) / 255.0f;
    srgb_[i] = LinearFromSrgb(linear_[i]);
  }
}

Vec4 TextureSampler::Texel(const scene::ImageData& image, int x, int y, bool srgb) const {
  const uint8_t* p = &image.rgba[(static_cast<size_t>(y) * image.width + x) * 4];
  const float* decode = srgb ? srgb_ : linear_;
  return {decode[p[0]], decode[p[1]], decode[p[2]], linear_[p[3]]};
}

Vec4 TextureSampler::Sample(const scene::TextureRef& ref, const Vec2 uv[2], bool srgb) const {
  if (ref.texture == scene::kNone) return {1, 1, 1, 1};
  const scene::Texture& texture = scene_->textures[ref.texture];
  if (texture.image == scene::kNone) return {1, 1, 1, 1};
  const scene::ImageData& image = scene_->images[texture.image];
  const Vec2 in = uv[ref.uv_set];
  const float u = ref.row_u.x * in.x + ref.row_u.y * in.y + ref.offset.x;
  const float v = ref.row_v.x * in.x + ref.row_v.y * in.y + ref.offset.y;
  const float x = BoundCoordinate(u * static_cast<float>(image.width));
  const float y = BoundCoordinate(v * static_cast<float>(image.height));
  if (texture.nearest) {
    return Texel(image, WrapTexel(static_cast<int>(std::floor(x)), image.width, texture.wrap_s),
                 WrapTexel(static_cast<int>(std::floor(y)), image.height, texture.wrap_t), srgb);
  }
  const float left = std::floor(x - 0.5f);
  const float top = std::floor(y - 0.5f);
  const int x0 = WrapTexel(static_cast<int>(left), image.width, texture.wrap_s);
  const int x1 = WrapTexel(static_cast<int>(left) + 1, image.width, texture.wrap_s);
  const int y0 = WrapTexel(static_cast<int>(top), image.height, texture.wrap_t);
  const int y1 = WrapTexel(static_cast<int>(top) + 1, image.height, texture.wrap_t);
  const float tx = x - 0.5f - left;
  const float ty = y - 0.5f - top;
  return Mix(Mix(Texel(image, x0, y0, srgb), Texel(image, x1, y0, srgb), tx),
             Mix(Texel(image, x0, y1, srgb), Texel(image, x1, y1, srgb), tx), ty);
}

Vec3 TextureSampler::Mean(const scene::TextureRef& ref, bool srgb) const {
  if (ref.texture == scene::kNone || scene_->textures[ref.texture].image == scene::kNone) return {1, 1, 1};
  const scene::ImageData& image = scene_->images[scene_->textures[ref.texture].image];
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

}  // namespace lumifold::render
