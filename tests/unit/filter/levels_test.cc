#include "filter/denoise/denoise.h"

#include <gtest/gtest.h>

#include <array>

#include "tests/unit/filter/edge_films.h"

namespace lumifold::filter {
namespace {

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
