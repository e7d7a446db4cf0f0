#include "filter/denoise/denoise.h"

#include <gtest/gtest.h>

#include <array>

#include "tests/unit/filter/edge_films.h"

namespace lumifold::filter {
namespace {

// A mirror in the wall shows two lit surfaces that meet at column 48.

constexpr Rect kMirrorRect = {30, 16, 66, 48};
constexpr float kReflectance = 0.9f;

float SeenInMirror(int x) { return x < 48 ? 1.0f : 0.25f; }

void AddMirrorPixel(int x, int y, Noise* noise, LayeredImage* film) {
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

LayeredImage MirrorFilm() {
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

double MirrorError(const ConstFloatView& picture) {
  double sum = 0;
  for (int y = kMirrorRect.y0; y < kMirrorRect.y1; ++y) {
    for (int x = kMirrorRect.x0; x < kMirrorRect.x1; ++x) {
      const double off = static_cast<double>(picture.At(x, y) - kReflectance * SeenInMirror(x));
      sum += off * off;
    }
  }
  return sum / (kMirrorRect.width() * kMirrorRect.height());
}

TEST(Reflections, AreFilteredByWhatTheyShow) {
  const LayeredImage film = MirrorFilm();
  const auto picture = Filtered(film, nullptr);
  const double noisy = MirrorError(film.GetColor(layers::kNoisy)[1]);
  EXPECT_LT(MirrorError(picture[1].view()), 0.05 * noisy);
  // The edge between the two surfaces in the mirror stays where it is.
  for (int y = 24; y < 40; ++y) EXPECT_GT(picture[1].At(46, y) - picture[1].At(49, y), 0.4f) << y;
}

TEST(Reflections, LeaveNoTraceAround) {
  const auto picture = Filtered(MirrorFilm(), nullptr);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      if (kMirrorRect.Contains(x, y)) continue;
      ASSERT_EQ(picture[0].At(x, y), 0) << x << " " << y;
    }
  }
}

TEST(Stages, WithoutLevelsThereIsMoreErrorInMirrors) {
  const LayeredImage mirror_film = MirrorFilm();
  const auto without_levels = Denoise(Frame(mirror_film), nullptr, {.off = {"levels"}, .watch = {}});
  EXPECT_GT(MirrorError(without_levels[1].view()),
            1.5 * MirrorError(Filtered(mirror_film, nullptr)[1].view()));
}

}  // namespace
}  // namespace lumifold::filter
