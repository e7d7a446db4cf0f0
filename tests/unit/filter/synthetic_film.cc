#include "synthetic_film.h"

#include <cmath>
#include <random>
#include <string>

#include "filter/image/layers.h"

namespace lumifold::filter {
namespace {

struct Surface {
  float normal[3] = {0, 0, 0};
  float distance = 0;  // 0: sky
  float albedo[3] = {0, 0, 0};
  float direct = 0;
  float indirect = 0;
  float emission = 0;
};

Surface SkyAt(float v) {
  Surface s;
  s.emission = 0.8f - v;
  return s;
}

Surface WallAt(float u, float v) {
  Surface s;
  s.normal[2] = 1;
  s.distance = 5;
  s.albedo[0] = 0.7f, s.albedo[1] = 0.5f, s.albedo[2] = 0.4f;
  s.direct = 0.3f + 0.5f * u;
  s.indirect = 0.2f + 0.1f * v;
  return s;
}

Surface BoxAt(float u) {
  Surface s;
  s.normal[0] = 0.6f, s.normal[2] = 0.8f;
  s.distance = 3.5f;
  s.albedo[0] = s.albedo[1] = s.albedo[2] = 0.8f;
  s.direct = 1.2f;
  s.indirect = 0.1f + 0.2f * u;
  return s;
}

Surface FloorAt(float u, float v, int x, int y) {
  Surface s;
  s.normal[1] = 1;
  s.distance = 2.5f / (v - 0.2f);
  const float shade = (x / 6 + y / 6) % 2 == 0 ? 0.8f : 0.2f;
  s.albedo[0] = s.albedo[1] = shade, s.albedo[2] = 0.5f;
  const bool is_shadowed = u + 0.4f * v > 0.9f && u + 0.4f * v < 1.15f;
  s.direct = is_shadowed ? 0.0f : 1.0f;
  s.indirect = 0.25f;
  return s;
}

Surface SurfaceAt(int x, int y, int width, int height) {
  const float u = (static_cast<float>(x) + 0.5f) / static_cast<float>(width);
  const float v = (static_cast<float>(y) + 0.5f) / static_cast<float>(height);
  if (v < 0.15f) return SkyAt(v);
  if (u > 0.3f && u < 0.5f && v > 0.35f && v < 0.75f) return BoxAt(u);
  return v < 0.6f ? WallAt(u, v) : FloorAt(u, v, x, y);
}

void SetColor(const ColorView& color, int x, int y, float r, float g, float b) {
  color[0].At(x, y) = r;
  color[1].At(x, y) = g;
  color[2].At(x, y) = b;
}

void SetGeometry(const Surface& s, int x, int y, LayeredImage* film) {
  film->Get(layers::kNormalX).At(x, y) = s.normal[0];
  film->Get(layers::kNormalY).At(x, y) = s.normal[1];
  film->Get(layers::kNormalZ).At(x, y) = s.normal[2];
  film->Get(layers::kDistance).At(x, y) = s.distance;
  film->Get(layers::kMask).At(x, y) = s.distance > 0 ? 1.0f : 0.0f;
  film->Get(layers::kSamplesA).At(x, y) = 8;
  film->Get(layers::kSamplesB).At(x, y) = 8;
  SetColor(film->GetColor(layers::kAlbedo), x, y, s.albedo[0], s.albedo[1], s.albedo[2]);
  SetColor(film->GetColor(layers::kEmission), x, y, s.emission, s.emission, s.emission);
}

/// One half's D, I and C of a pixel.
void SetHalf(const Surface& s, float direct, float indirect, const std::string& suffix, int x, int y,
             LayeredImage* film) {
  SetColor(film->GetColor(std::string(layers::kDirect) + suffix), x, y, direct, direct, direct);
  SetColor(film->GetColor(std::string(layers::kIndirect) + suffix), x, y, indirect, indirect, indirect);
  const float light = direct + indirect;
  SetColor(film->GetColor(std::string(layers::kNoisy) + suffix), x, y, light * s.albedo[0] + s.emission,
           light * s.albedo[1] + s.emission, light * s.albedo[2] + s.emission);
}

/// A factor of mean 1 and relative deviation `noise`, skewed like a path tracer's.
float NoiseFactor(float noise, std::mt19937* random) {
  if (noise == 0) return 1;
  const float shape = 1.0f / (noise * noise);
  return std::gamma_distribution<float>(shape, 1.0f / shape)(*random);
}

}  // namespace

SyntheticFilm MakeSyntheticFilm(int width, int height, float noise, uint32_t seed) {
  SyntheticFilm result{LayeredImage(width, height), LayeredImage(width, height)};
  LayeredImage& film = result.film;
  for (const std::string_view layer : layers::kHalved) {
    for (const std::string& name : {std::string(layer), layers::HalfA(layer), layers::HalfB(layer)})
      film.AddColor(name);
  }
  for (const std::string_view layer : {layers::kAlbedo, layers::kEmission}) film.AddColor(layer);
  for (const std::string_view name : {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance,
                                      layers::kMask, layers::kSamplesA, layers::kSamplesB}) {
    film.Add(name);
  }
  const ColorView truth = result.truth.AddColor(layers::kBeauty);
  const ColorView truth_direct = result.truth.AddColor(layers::kDirect);
  std::mt19937 random(seed);
  const float half_noise = noise * 1.41421356f;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Surface s = SurfaceAt(x, y, width, height);
      SetGeometry(s, x, y, &film);
      float direct[2];
      float indirect[2];
      for (int half = 0; half < 2; ++half) {
        direct[half] = s.direct * NoiseFactor(half_noise, &random);
        indirect[half] = s.indirect * NoiseFactor(half_noise, &random);
        SetHalf(s, direct[half], indirect[half], half == 0 ? "_a" : "_b", x, y, &film);
      }
      SetHalf(s, 0.5f * (direct[0] + direct[1]), 0.5f * (indirect[0] + indirect[1]), "", x, y, &film);
      const float light = s.direct + s.indirect;
      SetColor(truth, x, y, light * s.albedo[0] + s.emission, light * s.albedo[1] + s.emission,
               light * s.albedo[2] + s.emission);
      SetColor(truth_direct, x, y, s.direct, s.direct, s.direct);
    }
  }
  return result;
}

void ScaleRadiance(float factor, LayeredImage* film) {
  for (LayeredImage::Channel& channel : film->channels()) {
    bool is_radiance = channel.name.rfind(layers::kEmission, 0) == 0;
    for (const std::string_view layer : layers::kHalved) is_radiance |= channel.name.rfind(layer, 0) == 0;
    if (!is_radiance) continue;
    for (int y = 0; y < film->height(); ++y) {
      for (int x = 0; x < film->width(); ++x) channel.plane.At(x, y) *= factor;
    }
  }
}

}  // namespace lumifold::filter
