#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "filter/image/layered_image.h"
#include "filter/image/layers.h"
#include "filter/image/surface_key.h"
#include "tests/unit/filter/edge_films.h"

namespace lumifold::filter {

// An edge as EdgeFilm() has it, of films with fragments: each half has four samples a pixel.

inline constexpr float kSamples = 4;

struct FilmOfFragments {
  LayeredImage film;
  LayeredImage fragments;
};

inline void SetFragment(int row, int y, int side, const std::array<float, 2>& samples,
                        const float (&light)[2], LayeredImage* list) {
  list->Get(layers::kPixelX).At(0, row) = kEdgeColumn;
  list->Get(layers::kPixelY).At(0, row) = static_cast<float>(y);
  const FloatView normal[2] = {list->Get(layers::kNormalX), list->Get(layers::kNormalY)};
  SetSide(normal, list->Get(layers::kDistance), 0, row, side);
  list->Get(layers::kSurface).At(0, row) =
      SurfaceKey(static_cast<float>(side + 1), {normal[0].At(0, row), normal[1].At(0, row), 0},
                 list->Get(layers::kDistance).At(0, row));
  Set(list->GetColor(layers::kAlbedo), 0, row, kAlbedo[side]);
  Set(list->GetColor(layers::HalfA(layers::kDirect)), 0, row, light[0]);
  Set(list->GetColor(layers::HalfB(layers::kDirect)), 0, row, light[1]);
  list->Get(layers::kSamplesA).At(0, row) = samples[0];
  list->Get(layers::kSamplesB).At(0, row) = samples[1];
}

inline float Even(int) { return 1; }

/// Of light that ends in a corner: it falls off within few pixels.
inline float FallOff(int x) { return 1 - 0.9f * std::exp(0.25f * static_cast<float>(x - kEdgeColumn)); }

/// `left`: by which light on the left, at a column, is multiplied.
inline FilmOfFragments FilmWithFragments(uint32_t seed, float (*left)(int x) = Even) {
  FilmOfFragments out = {EdgeFilm(seed), LayeredImage(1, 2 * kHeight)};
  for (const std::string_view layer : {layers::kDirect, layers::kNoisy}) {
    for (const std::string& name : {std::string(layer), layers::HalfA(layer), layers::HalfB(layer)}) {
      for (const FloatView& channel : out.film.GetColor(name)) {
        for (int y = 0; y < kHeight; ++y) {
          for (int x = 0; x < kEdgeColumn; ++x) channel.At(x, y) *= left(x);
        }
      }
    }
  }
  for (const std::string& name : layers::FragmentChannels()) out.fragments.Add(name);
  for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB}) {
    for (int y = 0; y < kHeight; ++y) std::fill_n(out.film.Get(count).Row(y), kWidth, kSamples);
  }
  Noise noise(seed + 1000);
  for (int y = 0; y < kHeight; ++y) {
    const float right_a = y % 2 == 0 ? 1.0f : 3.0f;
    const std::array<float, 2> on_right = {right_a, kSamples - right_a};
    const std::array<float, 2> on_left = {on_right[1], on_right[0]};
    float of_left[2], right[2], light[2], radiance[2];
    for (size_t h = 0; h < 2; ++h) {
      of_left[h] = left(kEdgeColumn) * kLight[0] * noise();
      right[h] = kLight[1] * noise();
      light[h] = (on_left[h] * of_left[h] + on_right[h] * right[h]) / kSamples;
      radiance[h] = (on_left[h] * of_left[h] * kAlbedo[0] + on_right[h] * right[h] * kAlbedo[1]) / kSamples;
    }
    NoisyLayer(std::string(layers::kDirect), &out.film).Set(kEdgeColumn, y, light[0], light[1]);
    NoisyLayer(std::string(layers::kNoisy), &out.film).Set(kEdgeColumn, y, radiance[0], radiance[1]);
    SetFragment(2 * y, y, 0, on_left, of_left, &out.fragments);
    SetFragment(2 * y + 1, y, 1, on_right, right, &out.fragments);
  }
  return out;
}

/// The same with surfaces that are not even, a firefly, and halves without samples of pixels and fragments.
inline FilmOfFragments RoughFilmWithFragments(uint32_t seed) {
  FilmOfFragments out = FilmWithFragments(seed, FallOff);
  Noise noise(seed + 2000);
  for (LayeredImage* image : {&out.film, &out.fragments}) {
    for (const std::string_view name : {layers::kNormalX, layers::kNormalY, layers::kDistance}) {
      const FloatView channel = image->Get(name);
      for (int y = 0; y < channel.height(); ++y) {
        for (int x = 0; x < channel.width(); ++x) channel.At(x, y) += 0.05f * noise();
      }
    }
  }
  for (int y = 0; y < kHeight; y += 7) {
    for (int x = y % 5; x < kWidth; x += 9) out.film.Get(layers::kSamplesA).At(x, y) = 0;
    out.fragments.Get(y % 2 == 0 ? layers::kSamplesA : layers::kSamplesB).At(0, 2 * y + y % 2) = 0;
  }
  for (const std::string_view layer : {layers::kDirect, layers::kNoisy}) {
    out.film.GetColor(std::string(layer))[0].At(20, 30) += 40;
    out.film.GetColor(layers::HalfA(layer))[0].At(20, 30) += 80;
  }
  return out;
}

}  // namespace lumifold::filter
