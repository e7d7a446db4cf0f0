#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>
#include <string_view>
#include <utility>

#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/methods.h"

namespace lumifold::filter {

// Films of a wall, of an edge between two surfaces and of a mirror, whose truth is known.

inline constexpr int kWidth = 96;
inline constexpr int kHeight = 64;
inline constexpr float kNoise = 0.7f;  // relative deviation of a half
inline constexpr layers::Level kMirror = {layers::Branch::kReflection, 1};

inline void Set(const ColorView& color, int x, int y, float value) {
  for (const FloatView& channel : color) channel.At(x, y) = value;
}

inline void AddHalved(const std::string& layer, LayeredImage* film) {
  for (const std::string& name : {layer, layers::HalfA(layer), layers::HalfB(layer)}) film->AddColor(name);
}

/// An empty film, one wall at distance 2 all over it.
inline LayeredImage WallFilm() {
  LayeredImage film(kWidth, kHeight);
  for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect})
    AddHalved(std::string(layer), &film);
  for (const std::string_view layer : {layers::kAlbedo, layers::kEmission}) film.AddColor(layer);
  for (const std::string_view name : {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance,
                                      layers::kMask, layers::kSamplesA, layers::kSamplesB})
    film.Add(name);
  for (const std::string_view name : {layers::kNormalZ, layers::kMask, layers::kSamplesA, layers::kSamplesB})
    for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(name).Row(y), kWidth, 1.0f);
  for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(layers::kDistance).Row(y), kWidth, 2.0f);
  return film;
}

/// Writes a noisy layer into its mean and halves.
class NoisyLayer {
 public:
  NoisyLayer(const std::string& layer, LayeredImage* film)
      : mean_(film->GetColor(layer)),
        a_(film->GetColor(layers::HalfA(layer))),
        b_(film->GetColor(layers::HalfB(layer))) {}

  void Set(int x, int y, float a, float b) const {
    filter::Set(a_, x, y, a);
    filter::Set(b_, x, y, b);
    filter::Set(mean_, x, y, 0.5f * (a + b));
  }
  void Add(int x, int y, float a, float b) const { Set(x, y, a_[0].At(x, y) + a, b_[0].At(x, y) + b); }

 private:
  ColorView mean_, a_, b_;
};

class Noise {
 public:
  explicit Noise(uint32_t seed = 11) : random_(seed) {}
  float operator()() {
    return std::gamma_distribution<float>(1 / (kNoise * kNoise), kNoise * kNoise)(random_);
  }

 private:
  std::mt19937 random_;
};

inline Picture Filtered(const LayeredImage& film, const LayeredImage* edges,
                        const LayeredImage* fragments = nullptr) {
  auto picture = FilterFilm(film, "default", nullptr, edges, fragments);
  EXPECT_TRUE(picture.ok()) << picture.status();
  return *std::move(picture);
}

// A white, lit surface before a dark, shaded one: the edge runs through the middle of column 48. The mean of
// the products is 0.505, the product of the means 0.3025.

inline constexpr int kEdgeColumn = 48;
inline constexpr float kLight[2] = {1.0f, 0.1f};  // left, right
inline constexpr float kAlbedo[2] = {1.0f, 0.1f};

inline void SetSide(const FloatView (&normal)[2], const FloatView& distance, int x, int y, int side) {
  normal[side].At(x, y) = 1;
  distance.At(x, y) = side == 0 ? 2.0f : 3.0f;
}

inline LayeredImage EdgeFilm(uint32_t seed = 11) {
  LayeredImage film = WallFilm();
  for (int y = 0; y < kHeight; ++y) std::fill_n(film.Get(layers::kNormalZ).Row(y), kWidth, 0.0f);
  const FloatView normal[2] = {film.Get(layers::kNormalX), film.Get(layers::kNormalY)};
  Noise noise(seed);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      // What part of each half's samples falls on the right surface: the coverage is noisy, too.
      float right[2] = {x > kEdgeColumn ? 1.0f : 0.0f, x > kEdgeColumn ? 1.0f : 0.0f};
      if (x == kEdgeColumn) right[0] = 0.25f + 0.5f * static_cast<float>(y % 2), right[1] = 1 - right[0];
      float light[2], radiance[2];
      for (int half = 0; half < 2; ++half) {
        const float left = kLight[0] * noise() * (1 - right[half]);
        const float far = kLight[1] * noise() * right[half];
        light[half] = left + far;
        radiance[half] = left * kAlbedo[0] + far * kAlbedo[1];
      }
      NoisyLayer(std::string(layers::kDirect), &film).Set(x, y, light[0], light[1]);
      NoisyLayer(std::string(layers::kNoisy), &film).Set(x, y, radiance[0], radiance[1]);
      const float share = 0.5f * (right[0] + right[1]);
      Set(film.GetColor(layers::kAlbedo), x, y, kAlbedo[0] + share * (kAlbedo[1] - kAlbedo[0]));
      SetSide(normal, film.Get(layers::kDistance), x, y, x > kEdgeColumn ? 1 : 0);
    }
    for (const FloatView& side : normal) side.At(kEdgeColumn, y) = 0.5f;  // means over the sub-samples
    film.Get(layers::kDistance).At(kEdgeColumn, y) = 2.5f;
  }
  return film;
}

inline LayeredImage EdgeSet() {
  LayeredImage edges(kSubSamples, kHeight);
  for (const std::string& name : layers::EdgeChannels()) edges.Add(name);
  const FloatView normal[2] = {edges.Get(layers::kNormalX), edges.Get(layers::kNormalY)};
  for (int y = 0; y < kHeight; ++y) {
    for (int j = 0; j < kSubSamples; ++j) {
      const int side = j % 4 < 2 ? 0 : 1;
      edges.Get(layers::kPixelX).At(j, y) = kEdgeColumn;
      edges.Get(layers::kPixelY).At(j, y) = static_cast<float>(y);
      SetSide(normal, edges.Get(layers::kDistance), j, y, side);
      edges.Get(layers::kMask).At(j, y) = 1;
      edges.Get(layers::kObjectId).At(j, y) = static_cast<float>(side + 1);
      Set(edges.GetColor(layers::kAlbedo), j, y, kAlbedo[side]);
    }
  }
  return edges;
}

/// A film whose pixels in `where` show a mirror.
inline LayeredImage ShowingMirror(LayeredImage film, const Rect& where) {
  const FloatView distance = film.Add(layers::OfLevel(kMirror, layers::kDistance));
  for (int y = where.y0; y < where.y1; ++y) {
    for (int x = where.x0; x < where.x1; ++x) distance.At(x, y) = 4;
  }
  return film;
}

// A mirror in the wall shows two lit surfaces that meet at column 48.

inline constexpr Rect kMirrorRect = {30, 16, 66, 48};
inline constexpr float kReflectance = 0.9f;

inline float SeenInMirror(int x) { return x < 48 ? 1.0f : 0.25f; }

inline void AddMirrorPixel(int x, int y, Noise* noise, LayeredImage* film) {
  const auto channel = [&](std::string_view name) { return film->Get(layers::OfLevel(kMirror, name)); };
  const float a = SeenInMirror(x) * (*noise)();
  const float b = SeenInMirror(x) * (*noise)();
  NoisyLayer(layers::OfLevel(kMirror, layers::kDirect), film).Set(x, y, a, b);
  NoisyLayer(std::string(layers::kNoisy), film).Add(x, y, kReflectance * a, kReflectance * b);
  Set(film->GetColor(layers::OfLevel(kMirror, layers::kAlbedo)), x, y, kReflectance);
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB, layers::kMask})
    channel(name).At(x, y) = 1;
  channel(x < 48 ? layers::kNormalX : layers::kNormalY).At(x, y) = 1;
  channel(layers::kDistance).At(x, y) = x < 48 ? 4.0f : 6.0f;
  film->Get(layers::kMask).At(x, y) = 0;
}

inline LayeredImage MirrorFilm() {
  LayeredImage film = WallFilm();
  AddHalved(layers::OfLevel(kMirror, layers::kDirect), &film);
  AddHalved(layers::OfLevel(kMirror, layers::kIndirect), &film);
  for (const std::string_view layer : layers::kLevelWhole) film.AddColor(layers::OfLevel(kMirror, layer));
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB})
    film.Add(layers::OfLevel(kMirror, name));
  for (const std::string& name : layers::LevelFeatureChannels(kMirror)) film.Add(name);
  Noise noise;
  for (int y = kMirrorRect.y0; y < kMirrorRect.y1; ++y) {
    for (int x = kMirrorRect.x0; x < kMirrorRect.x1; ++x) AddMirrorPixel(x, y, &noise, &film);
  }
  return film;
}

}  // namespace lumifold::filter
