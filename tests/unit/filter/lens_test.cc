#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "filter/methods.h"
#include "tests/unit/filter/synthetic_film.h"

// Films of a lens, which makes T vary within a pixel.
namespace lumifold::filter {
namespace {

constexpr int kLensWidth = 128;
constexpr int kLensHeight = 96;
constexpr int kFirstBlurred = 64;      // column
constexpr float kDeviationOfT = 0.3f;  // of T of a half

/// A film whose T is noisy on the right: in each half by its own numbers, by which C of the half differs too.
LayeredImage FilmOfALens(SyntheticFilm* synthetic) {
  LayeredImage film = std::move(synthetic->film);
  std::mt19937 random(7);
  std::uniform_real_distribution<float> uniform(-1.7f, 1.7f);
  const std::array<std::string, 2> halves = {layers::HalfA(layers::kAlbedo), layers::HalfB(layers::kAlbedo)};
  const FloatView blur = film.Add(layers::kBlur);
  for (const std::string& half : halves) film.AddColor(half);
  ForEachPixel(kLensWidth, kLensHeight, [&](int x, int y) {
    const bool is_blurred = x >= kFirstBlurred;
    blur.At(x, y) = is_blurred ? 4.0f : 0.0f;
    const std::array<float, 2> factor = {1 + (is_blurred ? kDeviationOfT * uniform(random) : 0),
                                         1 + (is_blurred ? kDeviationOfT * uniform(random) : 0)};
    for (size_t c = 0; c < 3; ++c) {
      const float t = film.GetColor(layers::kAlbedo)[c].At(x, y);
      const auto light = [&](std::string (*half_of)(std::string_view)) {
        return film.GetColor(half_of(layers::kDirect))[c].At(x, y) +
               film.GetColor(half_of(layers::kIndirect))[c].At(x, y);
      };
      const std::array<float, 2> more = {light(layers::HalfA) * t * (factor[0] - 1),
                                         light(layers::HalfB) * t * (factor[1] - 1)};
      film.GetColor(layers::HalfA(layers::kNoisy))[c].At(x, y) += more[0];
      film.GetColor(layers::HalfB(layers::kNoisy))[c].At(x, y) += more[1];
      film.GetColor(layers::kNoisy)[c].At(x, y) += 0.5f * (more[0] + more[1]);
      for (size_t h = 0; h < 2; ++h) film.GetColor(halves[h])[c].At(x, y) = t * factor[h];
      film.GetColor(layers::kAlbedo)[c].At(x, y) = 0.5f * t * (factor[0] + factor[1]);
    }
  });
  return film;
}

/// The film without the channels whose names begin with one of these.
LayeredImage WithoutChannels(const LayeredImage& film, const std::vector<std::string>& names) {
  LayeredImage rest(film.width(), film.height());
  for (const LayeredImage::Channel& channel : film.channels()) {
    if (std::none_of(names.begin(), names.end(),
                     [&](const std::string& name) { return channel.name.starts_with(name); }))
      rest.Add(channel.name, channel.plane.Clone());
  }
  return rest;
}

/// The same film as if it did not know of its lens.
LayeredImage WithoutLens(const LayeredImage& film) {
  return WithoutChannels(
      film, {std::string(layers::kBlur), layers::HalfA(layers::kAlbedo), layers::HalfB(layers::kAlbedo)});
}

/// Mean square error of some columns, without the worst 2 %.
double ErrorOfColumns(const Picture& picture, const LayeredImage& truth, int x0, int x1) {
  std::vector<double> errors;
  for (int y = 0; y < kLensHeight; ++y) {
    for (int x = x0; x < x1; ++x) {
      double sum = 0;
      for (size_t c = 0; c < 3; ++c) {
        const auto off =
            static_cast<double>(picture[c].At(x, y) - truth.GetColor(layers::kBeauty)[c].At(x, y));
        sum += off * off / 3;
      }
      errors.push_back(sum);
    }
  }
  std::sort(errors.begin(), errors.end());
  errors.resize(errors.size() * 49 / 50);
  double sum = 0;
  for (const double error : errors) sum += error;
  return sum / static_cast<double>(errors.size());
}

TEST(Lens, NoiseOfAlbedoIsFilteredWhereItIsBlurredAlone) {
  SyntheticFilm synthetic = MakeSyntheticFilm(kLensWidth, kLensHeight, 0.1f, 3);
  const LayeredImage film = FilmOfALens(&synthetic);
  const Picture by_lens = *FilterFilm(film, "default", nullptr);
  const Picture without = *FilterFilm(WithoutLens(film), "default", nullptr);
  constexpr int kMargin = 8;
  EXPECT_LE(ErrorOfColumns(by_lens, synthetic.truth, kFirstBlurred + kMargin, kLensWidth),
            0.4 * ErrorOfColumns(without, synthetic.truth, kFirstBlurred + kMargin, kLensWidth));
  EXPECT_LE(ErrorOfColumns(by_lens, synthetic.truth, 0, kFirstBlurred - kMargin),
            1.1 * ErrorOfColumns(without, synthetic.truth, 0, kFirstBlurred - kMargin));
}

TEST(Lens, NoiseOfAlbedoIsFilteredInFilmsOfOtherRenderers) {
  SyntheticFilm synthetic = MakeSyntheticFilm(kLensWidth, kLensHeight, 0.1f, 3);
  const LayeredImage film = FilmOfALens(&synthetic);
  const Picture by_halves =
      *FilterFilm(WithoutChannels(film, {std::string(layers::kBlur)}), "default", nullptr);
  const Picture by_mean = *FilterFilm(WithoutLens(film), "default", nullptr);
  EXPECT_LE(ErrorOfColumns(by_halves, synthetic.truth, 0, kLensWidth),
            0.4 * ErrorOfColumns(by_mean, synthetic.truth, 0, kLensWidth));
}

TEST(Lens, AFilmInFocusKeepsItsPicture) {
  SyntheticFilm synthetic = MakeSyntheticFilm(kLensWidth, kLensHeight, 0.1f, 3);
  const Picture expected = *FilterFilm(synthetic.film, "default", nullptr);
  synthetic.film.Add(layers::kBlur);
  const Picture picture = *FilterFilm(synthetic.film, "default", nullptr);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < kLensHeight; ++y) {
      ASSERT_TRUE(std::equal(expected[c].Row(y), expected[c].Row(y) + kLensWidth, picture[c].Row(y))) << y;
    }
  }
}

}  // namespace
}  // namespace lumifold::filter
