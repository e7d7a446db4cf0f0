#include "filter/denoise/convergence.h"

#include <gtest/gtest.h>

#include <array>
#include <string>
#include <string_view>

#include "filter/image/layers.h"

namespace lumifold::filter {
namespace {

constexpr int kSize = 48;
constexpr int kLamp = 24;  // columns from here on are noisy
constexpr int kBeside = 20;
constexpr float kOff = 0.3f;

/// C is 1 everywhere, without noise on the left and with a deviation of 0.45 on the right.
LayeredImage FilmOf(float samples) {
  LayeredImage film(kSize, kSize);
  for (const std::string_view layer : {"noisy", "noisy_a", "noisy_b"}) {
    for (const FloatView& plane : film.AddColor(layer)) {
      for (int y = 0; y < kSize; ++y) {
        for (int x = 0; x < kSize; ++x) {
          const float noise = x < kLamp || layer == layers::kNoisy ? 0.0f : 0.45f;
          plane.At(x, y) = 1 + (layer == "noisy_a" ? noise : -noise);
        }
      }
    }
  }
  for (const std::string_view half : {layers::kSamplesA, layers::kSamplesB}) {
    const FloatView count = film.Add(std::string(half));
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) count.At(x, y) = samples / 2;
    }
  }
  return film;
}

/// How far a picture that is wrong by kOff is still off beside the noise.
float OffAfterShrinking(float samples) {
  const LayeredImage film = FilmOf(samples);
  std::array<Plane, 3> picture;
  for (Plane& plane : picture) {
    plane = Plane(kSize, kSize);
    plane.Fill(1 + kOff);
  }
  ShrinkResidual(Frame(film), nullptr, &picture);
  return picture[0].At(kBeside, kSize / 2) - 1;
}

TEST(ShrinkResidual, TakesNoiseNearByForItsOwnAtFewSamples) {
  EXPECT_FLOAT_EQ(OffAfterShrinking(4), kOff);
  EXPECT_FLOAT_EQ(OffAfterShrinking(16), kOff);
}

TEST(ShrinkResidual, ConvergesBesideNoiseAtManySamples) {
  EXPECT_LT(OffAfterShrinking(1024), 0.1f * kOff);
  EXPECT_LT(OffAfterShrinking(65536), 0.002f * kOff);
}

/// What a picture that is 1 shows in the midst of the noise where C has `bright` pixels of 100, alike in both
/// halves.
float ShownOfBright(int bright, float samples) {
  LayeredImage film = FilmOf(samples);
  std::array<Plane, 3> picture;
  for (size_t c = 0; c < 3; ++c) {
    picture[c] = Plane(kSize, kSize);
    picture[c].Fill(1);
    for (const std::string_view layer : {"noisy", "noisy_a", "noisy_b"}) {
      for (int i = 0; i < bright; ++i) film.GetColor(layer)[c].At(36 + i, 24) += 99;
    }
  }
  ShrinkResidual(Frame(film), nullptr, &picture);
  return picture[0].At(36, 24);
}

TEST(ShrinkResidual, DoesNotFollowAPixelAloneOfFewSamples) {
  EXPECT_FLOAT_EQ(ShownOfBright(1, 4), 1);
  EXPECT_GT(ShownOfBright(2, 4), 20);
  EXPECT_GT(ShownOfBright(1, 1024), 50);
}

}  // namespace
}  // namespace lumifold::filter
