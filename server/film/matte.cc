#include "server/film/matte.h"

#include <algorithm>
#include <array>
#include <string_view>

#include "filter/image/layers.h"
#include "filter/image/planes.h"

namespace lumifold::film {
namespace {

float OverOr0(float value, float by) { return by > 0 ? value / by : 0.0f; }

/// Moves the opacity of edge pixels towards the coverage that their sub-samples have.
void UseSubSamples(const EdgedImage& film, Plane* opacity) {
  const ConstFloatView covered = film.pixels.Get(layers::kAlpha);
  const ConstFloatView count_a = film.pixels.Get(layers::kSamplesA);
  const ConstFloatView count_b = film.pixels.Get(layers::kSamplesB);
  constexpr float kSquare = kSubSamples * kSubSamples;
  for (int row = 0; row < film.edges.height(); ++row) {
    const int x = static_cast<int>(film.edges.Get(layers::kPixelX).At(0, row));
    const int y = static_cast<int>(film.edges.Get(layers::kPixelY).At(0, row));
    const float half = (count_a.At(x, y) + count_b.At(x, y)) / 2;
    float& value = opacity->At(x, y);
    value += (covered.At(x, y) - value) * (kSquare / (kSquare + half * half));
  }
}

/// The channels of ShadowFilmOf.
class ShadowPicture {
 public:
  ShadowPicture(int width, int height) : image_(width, height) {
    for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect}) {
      image_.AddColor(layer);
      image_.AddColor(layers::HalfA(layer));
      image_.AddColor(layers::HalfB(layer));
    }
    for (const std::string_view layer : {layers::kAlbedo, layers::kEmission}) image_.AddColor(layer);
    for (const std::string_view name :
         {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance, layers::kMask,
          layers::kSamplesA, layers::kSamplesB})
      image_.Add(name);
  }

  /// The same in all three channels.
  void Set(std::string_view layer, int x, int y, float value) {
    for (const FloatView& channel : image_.GetColor(layer)) channel.At(x, y) = value;
  }
  void SetPlane(std::string_view name, int x, int y, float value) { image_.Get(name).At(x, y) = value; }
  LayeredImage Take() { return std::move(image_); }

 private:
  LayeredImage image_;
};

}  // namespace

Plane AlphaOf(const EdgedImage& film, bool is_filtered) {
  const LayeredImage& pixels = film.pixels;
  Plane alpha = Plane::Uninitialized(pixels.width(), pixels.height());
  const ConstFloatView sampled = pixels.Get(layers::kOpacity);
  CopyPlane(sampled, alpha.view());
  if (is_filtered) UseSubSamples(film, &alpha);
  if (!pixels.Has(layers::kShadow)) return alpha;
  const ConstFloatView shadow = pixels.Get(layers::kShadow);
  ForEachPixel(pixels.width(), pixels.height(), [&](int x, int y) {
    const float opacity = alpha.At(x, y);
    const float rest = OverOr0(shadow.At(x, y), 1 - sampled.At(x, y)) * (1 - opacity);
    alpha.At(x, y) = std::clamp(opacity + rest, 0.0f, 1.0f);
  });
  return alpha;
}

LayeredImage ShadowFilmOf(const LayeredImage& film) {
  ShadowPicture out(film.width(), film.height());
  const ConstFloatView catcher = film.Get(layers::kCatcher);
  const std::array<ConstFloatView, 2> count = {film.Get(layers::kSamplesA), film.Get(layers::kSamplesB)};
  const std::array<ConstFloatView, 2> light = {film.Get(layers::kCatcherLight[0]),
                                               film.Get(layers::kCatcherLight[1])};
  const std::array<ConstFloatView, 2> shadow = {film.Get(layers::kCatcherShadow[0]),
                                                film.Get(layers::kCatcherShadow[1])};
  ForEachPixel(film.width(), film.height(), [&](int x, int y) {
    const float n[2] = {count[0].At(x, y), count[1].At(x, y)};
    out.SetPlane(layers::kSamplesA, x, y, n[0]);
    out.SetPlane(layers::kSamplesB, x, y, n[1]);
    const float covered = catcher.At(x, y);
    if (covered <= 0) return;
    const float l[2] = {light[0].At(x, y), light[1].At(x, y)};
    const float s[2] = {shadow[0].At(x, y), shadow[1].At(x, y)};
    const float both = OverOr0(s[0] * n[0] + s[1] * n[1], l[0] * n[0] + l[1] * n[1]);
    const auto set = [&](std::string_view noisy, std::string_view direct, float part) {
      out.Set(direct, x, y, part);
      out.Set(noisy, x, y, part * covered);
    };
    set(layers::kNoisy, layers::kDirect, both);
    set(layers::HalfA(layers::kNoisy), layers::HalfA(layers::kDirect), l[0] > 0 ? s[0] / l[0] : both);
    set(layers::HalfB(layers::kNoisy), layers::HalfB(layers::kDirect), l[1] > 0 ? s[1] / l[1] : both);
    out.Set(layers::kAlbedo, x, y, covered);
    out.SetPlane(layers::kMask, x, y, covered);
    out.SetPlane(layers::kNormalY, x, y, 1);
    out.SetPlane(layers::kDistance, x, y, 1);
  });
  return out.Take();
}

absl::StatusOr<EdgedImage> ShadowFilm::Read(const Rect& rect) {
  const absl::StatusOr<EdgedImage> part = film_.Read(rect);
  if (!part.ok()) return part.status();
  return EdgedImage{ShadowFilmOf(part->pixels), {}, {}};
}

}  // namespace lumifold::film
