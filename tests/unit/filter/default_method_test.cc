#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "filter/denoise/denoise.h"
#include "filter/image/layers.h"
#include "filter/methods.h"
#include "tests/unit/filter/are_equal.h"
#include "tests/unit/filter/edge_films.h"
#include "tests/unit/filter/fragment_films.h"
#include "tests/unit/filter/manifold_oracle.h"
#include "tests/unit/filter/synthetic_film.h"

// The default method as a whole, where one of its parts alone could spoil the picture.
namespace lumifold::filter {
namespace {

constexpr std::array<int, 2> kStruck = {30, 70};  // on the wall

/// Mean square error of all pixels but the one that was struck and the worst 0.2 %. A few pixels at a corner
/// of the shadow have a third of all error, and change with the least change of the guide.
double ErrorAround(const ConstColorView& picture, const SyntheticFilm& synthetic) {
  const ConstColorView truth = std::as_const(synthetic.truth).GetColor(layers::kBeauty);
  std::vector<double> errors;
  ForEachPixel(picture[0].width(), picture[0].height(), [&](int x, int y) {
    if (x == kStruck[0] && y == kStruck[1]) return;
    double sum = 0;
    for (size_t c = 0; c < 3; ++c) {
      const auto off = static_cast<double>(picture[c].At(x, y) - truth[c].At(x, y));
      sum += off * off / 3;
    }
    errors.push_back(sum);
  });
  std::sort(errors.begin(), errors.end());
  const size_t count = errors.size() - errors.size() / 500;
  return std::accumulate(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(count), 0.0) /
         static_cast<double>(count);
}

/// Adds `times` a pixel's D to one of its halves.
void Strike(float times, LayeredImage* film) {
  const auto [x, y] = kStruck;
  for (size_t c = 0; c < 3; ++c) {
    const float more = times * film->GetColor(layers::kDirect)[c].At(x, y);
    const float seen = more * film->GetColor(layers::kAlbedo)[c].At(x, y);
    film->GetColor(layers::HalfA(layers::kDirect))[c].At(x, y) += more;
    film->GetColor(layers::kDirect)[c].At(x, y) += 0.5f * more;
    film->GetColor(layers::HalfA(layers::kNoisy))[c].At(x, y) += seen;
    film->GetColor(layers::kNoisy)[c].At(x, y) += 0.5f * seen;
  }
}

/// Makes D of each half as noisy as if one of `rarity` samples hit light that is so many times as bright, of
/// 8 samples.
void MakeLightRare(uint32_t rarity, uint32_t seed, LayeredImage* film) {
  std::mt19937 random(seed);
  ForEachPixel(film->width(), film->height(), [&](int x, int y) {
    for (const auto name_of : {layers::HalfA, layers::HalfB}) {
      uint32_t hits = 0;
      for (int sample = 0; sample < 8; ++sample) hits += random() % rarity == 0 ? 1 : 0;
      for (size_t c = 0; c < 3; ++c) {
        const float direct = film->GetColor(name_of(layers::kDirect))[c].At(x, y);
        const float more = (static_cast<float>(hits * rarity) / 8 - 1) * direct;
        const float seen = more * film->GetColor(layers::kAlbedo)[c].At(x, y);
        film->GetColor(name_of(layers::kDirect))[c].At(x, y) += more;
        film->GetColor(layers::kDirect)[c].At(x, y) += 0.5f * more;
        film->GetColor(name_of(layers::kNoisy))[c].At(x, y) += seen;
        film->GetColor(layers::kNoisy)[c].At(x, y) += 0.5f * seen;
      }
    }
  });
}

constexpr Rect kWall = {16, 50, 44, 84};  // a part of the wall

/// Mean square of how much the errors of neighbours in a row differ, on the wall.
double Roughness(const ConstColorView& picture, const SyntheticFilm& synthetic) {
  const ConstFloatView shown = picture[1].Crop(kWall);
  const ConstFloatView truth = std::as_const(synthetic.truth).GetColor(layers::kBeauty)[1].Crop(kWall);
  double sum = 0;
  for (int y = 0; y < shown.height(); ++y) {
    for (int x = 1; x < shown.width(); ++x) {
      const auto step =
          static_cast<double>(shown.At(x, y) - truth.At(x, y) - shown.At(x - 1, y) + truth.At(x - 1, y));
      sum += step * step;
    }
  }
  return sum / shown.height() / (shown.width() - 1);
}

TEST(DefaultMethod, RareLightLeavesFewSpecks) {
  // Outliers are taken out where the other half contradicts them. What is left agrees by selection: compared
  // with that, a part of the noisy layer passes for detail, and .038 of its roughness stays.
  SyntheticFilm synthetic = MakeSyntheticFilm(160, 120, 0.05f, 4);
  MakeLightRare(60, 7, &synthetic.film);
  const double noisy = Roughness(std::as_const(synthetic.film).GetColor(layers::kNoisy), synthetic);
  EXPECT_LT(Roughness(ViewOf(Filtered(synthetic.film, nullptr)), synthetic), 0.025 * noisy);
}

double MedianOf(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

TEST(DefaultMethod, ReturnedEnergyIsMostOfTheNoiseOfRareLight) {
  constexpr int kFilms = 8;
  struct Pixel {
    double sum = 0;
    double square = 0;
    double all = 0;    // mean square of the deviation with returned energy
    double local = 0;  // without it
  };
  std::vector<Pixel> pixels(static_cast<size_t>(kWall.width() * kWall.height()));
  for (uint32_t seed = 1; seed <= kFilms; ++seed) {
    SyntheticFilm synthetic = MakeSyntheticFilm(160, 120, 0.05f, seed);
    MakeLightRare(300, seed, &synthetic.film);
    const FilteredPicture filtered = DenoiseWithDeviation(Frame(synthetic.film), nullptr);
    for (size_t i = 0; i < pixels.size(); ++i) {
      const int x = kWall.x0 + static_cast<int>(i) % kWall.width();
      const int y = kWall.y0 + static_cast<int>(i) / kWall.width();
      const auto value = static_cast<double>(filtered.picture[1].At(x, y));
      const auto local = static_cast<double>(filtered.deviation[1].At(x, y));
      const double all = local + static_cast<double>(filtered.returned[1].At(x, y));
      pixels[i].sum += value;
      pixels[i].square += value * value;
      pixels[i].all += all * all / kFilms;
      pixels[i].local += local * local / kFilms;
    }
  }
  // Medians: where a sample of each half has met the rare light in one pixel, it stays a speck.
  std::vector<double> variance;
  std::vector<double> of_all;
  std::vector<double> of_local;
  for (const Pixel& pixel : pixels) {
    variance.push_back((pixel.square - pixel.sum * pixel.sum / kFilms) / (kFilms - 1));
    of_all.push_back(pixel.all);
    of_local.push_back(pixel.local);
  }
  // The part of it that returns, 1 - 1/n of n outliers, is the same for both halves, so that they do not show
  // all.
  EXPECT_GT(MedianOf(of_all), 0.3 * MedianOf(variance));
  EXPECT_LT(MedianOf(of_all), 1.2 * MedianOf(variance));
  EXPECT_LT(MedianOf(of_local), 0.1 * MedianOf(variance));
}

TEST(DefaultMethod, OneFireflyChangesNothingAround) {
  for (const float noise : {0.1f, 0.4f}) {
    SyntheticFilm synthetic = MakeSyntheticFilm(160, 120, noise, 4);
    const double noisy = ErrorAround(std::as_const(synthetic.film).GetColor(layers::kNoisy), synthetic);
    const double without = ErrorAround(ViewOf(Filtered(synthetic.film, nullptr)), synthetic);
    for (const float times : {500.0f, 3000.0f}) {
      SyntheticFilm struck = MakeSyntheticFilm(160, 120, noise, 4);
      Strike(times, &struck.film);
      const double with = ErrorAround(ViewOf(Filtered(struck.film, nullptr)), struck);
      EXPECT_LT(with, 1.05 * without) << times << " at noise " << noise;
      EXPECT_LT(with, noisy) << times << " at noise " << noise;
    }
  }
}

/// `left`: by which light of the left surface is multiplied there.
double ErrorAtEdge(const Picture& picture, float left = 1) {
  const float truth = 0.5f * (left * kLight[0] * kAlbedo[0] + kLight[1] * kAlbedo[1]);
  double sum = 0;
  for (int y = 0; y < kHeight; ++y) {
    const auto off = static_cast<double>(picture[1].At(kEdgeColumn, y) - truth);
    sum += off * off / kHeight;
  }
  return sum;
}

TEST(DefaultMethod, IsTheSameOnADevice) {
  const LayeredImage edges = EdgeSet();
  const FilmOfFragments film = RoughFilmWithFragments(1);
  const Frame frames[] = {Frame(film.film, &edges, &film.fragments), Frame(film.film, &edges),
                          Frame(film.film)};
  for (const bool is_small : {false, true}) {
    for (const char* off :
         {"regression", "choice", "light-regression", "second-filtering", "noisy-choice", "firefly-energy"}) {
      for (const Frame& frame : frames) {
        const DenoiseOptions options = {.off = {off}};
        const FilteredPicture there = DenoiseWithDeviation(frame, PoolWithOracle(is_small).get(), options);
        const FilteredPicture here = DenoiseWithDeviation(frame, nullptr, options);
        EXPECT_TRUE(AreEqual(there.picture, here.picture)) << off;
        EXPECT_TRUE(AreEqual(there.deviation, here.deviation)) << off;
        EXPECT_TRUE(AreEqual(there.returned, here.returned)) << off;
      }
    }
  }
}

TEST(DefaultMethod, EdgesHaveLessErrorWithFragments) {
  double with = 0;
  double without = 0;
  double noisy = 0;
  const LayeredImage edges = EdgeSet();
  for (uint32_t seed = 1; seed <= 4; ++seed) {
    const FilmOfFragments film = FilmWithFragments(seed);
    with += ErrorAtEdge(Filtered(film.film, &edges, &film.fragments));
    without += ErrorAtEdge(Filtered(film.film, &edges));
    noisy += ErrorAtEdge(ClonePicture(film.film.GetColor(layers::kNoisy)));
  }
  EXPECT_LT(with, 0.5 * without);
  EXPECT_LT(with, 0.1 * noisy);
}

TEST(DefaultMethod, LightThatFallsOffTowardsAnEdgeIsFittedThere) {
  const LayeredImage edges = EdgeSet();
  double with = 0;
  double without = 0;
  for (uint32_t seed = 1; seed <= 4; ++seed) {
    const FilmOfFragments film = FilmWithFragments(seed, FallOff);
    const Frame frame(film.film, &edges, &film.fragments);
    const auto error = [&](const SwitchedOff& off) {
      return ErrorAtEdge(Denoise(frame, nullptr, {.off = off, .watch = {}}), FallOff(kEdgeColumn));
    };
    with += error({"regression"});
    without += error({"regression", "light-regression"});
  }
  EXPECT_LT(with, 0.8 * without);
}

/// The film as half A alone has it.
FilmOfFragments OnlyHalfA(FilmOfFragments film) {
  for (LayeredImage* image : {&film.film, &film.fragments}) {
    const FloatView samples = image->Get(layers::kSamplesB);
    for (int y = 0; y < image->height(); ++y) std::fill_n(samples.Row(y), image->width(), 0.0f);
  }
  for (const std::string_view layer : {layers::kNoisy, layers::kDirect}) {
    const ConstColorView half = std::as_const(film.film).GetColor(layers::HalfA(layer));
    const ColorView mean = film.film.GetColor(layer);
    for (size_t c = 0; c < 3; ++c) CopyPlane(half[c], mean[c]);
  }
  return film;
}

TEST(DefaultMethod, EdgesOfOneHalfHaveLessErrorWithFragments) {
  double with = 0;
  double without = 0;
  const LayeredImage edges = EdgeSet();
  for (uint32_t seed = 1; seed <= 4; ++seed) {
    const FilmOfFragments film = OnlyHalfA(FilmWithFragments(seed));
    with += ErrorAtEdge(Filtered(film.film, &edges, &film.fragments));
    without += ErrorAtEdge(Filtered(film.film, &edges));
  }
  EXPECT_LT(with, 0.5 * without);
}

constexpr int kLampRows = 21;  // one in so many rows of the edge column has a slice of the lamp

/// A slice of a lamp, on the right surface: three samples of one half see it, and one of the other.
FilmOfFragments FilmWithLamp(LayeredImage* edges) {
  constexpr float kLamp = 8;
  FilmOfFragments out = FilmWithFragments(1);
  const NoisyLayer noisy(std::string(layers::kNoisy), &out.film);
  for (int y = 0; y < kHeight; y += kLampRows) {
    const float right_a = y % 2 == 0 ? 0.25f : 0.75f;
    noisy.Add(kEdgeColumn, y, kLamp * right_a, kLamp * (1 - right_a));
    Set(out.film.GetColor(layers::kEmission), kEdgeColumn, y, 0.5f * kLamp);
    Set(out.fragments.GetColor(layers::kEmission), 0, 2 * y + 1, kLamp);
    for (int j = 0; j < kSubSamples; ++j) {
      if (edges->Get(layers::kObjectId).At(j, y) == 2) Set(edges->GetColor(layers::kEmission), j, y, kLamp);
    }
  }
  return out;
}

double SumOfSquaresAtLamp(const Picture& picture) {
  double sum = 0;
  for (int y = 0; y < kHeight; y += kLampRows) {
    const auto value = static_cast<double>(picture[1].At(kEdgeColumn, y));
    sum += value * value;
  }
  return sum;
}

TEST(DefaultMethod, TheRimOfALampIsAsCertainAsItsSubSamplesMakeIt) {
  LayeredImage edges = EdgeSet();
  FilmOfFragments film = FilmWithLamp(&edges);
  const auto deviation = [&] {
    return DenoiseWithDeviation(Frame(film.film, &edges, &film.fragments), nullptr).deviation;
  };
  const double with = SumOfSquaresAtLamp(deviation());
  for (int row = 0; row < film.fragments.height(); ++row)
    Set(film.fragments.GetColor(layers::kEmission), 0, row, 0);  // as films of earlier versions
  const double without = SumOfSquaresAtLamp(deviation());
  EXPECT_LT(with, 0.01 * without);
}

TEST(DefaultMethod, LongAndThinFilmsOfPlanarLightStayAsTheyAre) {
  constexpr int kLong = 4200;
  LayeredImage film = MakeSyntheticFilm(8, kLong, 0, 1).film;
  for (const LayeredImage::Channel& channel : film.channels()) {
    const auto is_of = [&](std::string_view name) { return channel.name.starts_with(name); };
    ForEachPixel(8, kLong, [&](int x, int y) {
      const float light = 1 + static_cast<float>(y) / kLong;
      float value = 0;
      if (is_of(layers::kDirect)) value = light;
      if (is_of(layers::kAlbedo)) value = 0.5f;
      if (is_of(layers::kNoisy)) value = 0.5f * light;
      if (is_of(layers::kSamplesA) || is_of(layers::kSamplesB)) value = 8;
      if (is_of(layers::kNormalZ) || is_of(layers::kMask)) value = 1;
      if (is_of(layers::kDistance)) value = 4;
      film.Get(channel.name).At(x, y) = value;
    });
  }
  const Picture picture = Filtered(film, nullptr);
  for (int y = 0; y < kLong; ++y) {
    const float truth = 0.5f * (1 + static_cast<float>(y) / kLong);
    ASSERT_NEAR(picture[1].At(4, y), truth, 1e-4f) << y;
  }
}

TEST(DefaultMethod, OneHalfIsFilteredAsSuchThoughAPixelHasBoth) {
  LayeredImage film = MakeSyntheticFilm(64, 48, 0.3f, 2).film;
  for (int y = 0; y < 48; ++y) std::fill_n(film.Get(layers::kSamplesB).Row(y), 64, 0.0f);
  film.Get(layers::kSamplesB).At(20, 30) = 8;
  std::vector<std::string> ran;
  const StageWatch watch = [&](std::string_view stage) { ran.emplace_back(stage); };
  Denoise(Frame(film), nullptr, {.off = {}, .watch = watch});
  EXPECT_NE(std::find(ran.begin(), ran.end(), "single-filtering"), ran.end());
  EXPECT_EQ(std::find(ran.begin(), ran.end(), "first-filtering"), ran.end());
}

}  // namespace
}  // namespace lumifold::filter
