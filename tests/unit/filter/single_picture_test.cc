#include "filter/layers/single_picture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "filter/image/film_layout.h"
#include "filter/image/layers.h"
#include "filter/layers/product.h"
#include "filter/methods.h"
#include "filter/metrics/metrics.h"
#include "tests/support/shuffling_pool.h"
#include "tests/unit/filter/synthetic_film.h"

namespace lumifold::filter {
namespace {

constexpr int kPictureWidth = 160;
constexpr int kPictureHeight = 120;

/// The film as a renderer without halves would write it.
LayeredImage WithoutHalves(LayeredImage film) {
  std::erase_if(film.channels(), [](const LayeredImage::Channel& channel) {
    return channel.name.find("_a.") != std::string::npos || channel.name.find("_b.") != std::string::npos;
  });
  return film;
}

/// RMS of the noise that the halves say the layer's mean has.
double NoiseOf(const LayeredImage& film, std::string_view layer) {
  const ConstColorView a = film.GetColor(layers::HalfA(layer));
  const ConstColorView b = film.GetColor(layers::HalfB(layer));
  const ConstFloatView distance = film.Get(layers::kDistance);
  double sum = 0;
  double count = 0;
  for (int y = 0; y < film.height(); ++y) {
    for (int x = 0; x < film.width(); ++x) {
      if (distance.At(x, y) == 0) continue;
      const double difference = static_cast<double>(a[1].At(x, y) - b[1].At(x, y));
      sum += difference * difference / 4;
      count += 1;
    }
  }
  return std::sqrt(sum / count);
}

TEST(SinglePicture, EstimatesTheNoiseThatTrueHalvesMeasure) {
  for (const float noise : {0.05f, 0.2f, 0.5f}) {
    LayeredImage film = MakeSyntheticFilm(kPictureWidth, kPictureHeight, noise, 3).film;
    const double measured = NoiseOf(film, layers::kDirect);
    film = WithoutHalves(std::move(film));
    SplitIntoHalves(&film, nullptr);
    EXPECT_NEAR(NoiseOf(film, layers::kDirect) / measured, 1, 0.25) << noise;
  }
}

TEST(SinglePicture, HalvesHaveThePictureForMean) {
  LayeredImage film = WithoutHalves(MakeSyntheticFilm(kPictureWidth, kPictureHeight, 0.3f, 1).film);
  SplitIntoHalves(&film, nullptr);
  for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect}) {
    const float a = film.GetColor(layers::HalfA(layer))[0].At(50, 100);
    const float b = film.GetColor(layers::HalfB(layer))[0].At(50, 100);
    EXPECT_NE(a, b) << layer;
    EXPECT_NEAR(0.5f * (a + b), film.GetColor(layer)[0].At(50, 100), 1e-5) << layer;
  }
}

TEST(SinglePicture, SplitsLightThroughASurfaceLikeAnyOther) {
  LayeredImage film = WithoutHalves(MakeSyntheticFilm(kPictureWidth, kPictureHeight, 0.3f, 1).film);
  for (const std::string_view layer : {layers::kTransmitted, layers::kTransmittance}) {
    const ColorView out = film.AddColor(layer);
    for (size_t c = 0; c < 3; ++c) CopyPlane(std::as_const(film).GetColor(layers::kIndirect)[c], out[c]);
  }
  SplitIntoHalves(&film, nullptr);
  const Frame frame(film);
  const std::vector<Product> products = ProductsOf(frame, {}, nullptr);
  EXPECT_TRUE(std::any_of(products.begin(), products.end(), [&](const Product& product) {
    return product.mean[0].Row(0) == std::as_const(film).GetColor(layers::kTransmitted)[0].Row(0);
  }));
  EXPECT_NE(film.GetColor(layers::HalfA(layers::kTransmitted))[0].At(50, 100),
            film.GetColor(layers::HalfB(layers::kTransmitted))[0].At(50, 100));
}

TEST(SinglePicture, FindsNoNoiseWhereThereIsNone) {
  LayeredImage film = WithoutHalves(MakeSyntheticFilm(kPictureWidth, kPictureHeight, 0, 1).film);
  SplitIntoHalves(&film, nullptr);
  EXPECT_LT(NoiseOf(film, layers::kIndirect), 1e-3);
}

TEST(SinglePicture, LetsTheFilterTakeMostOfTheNoise) {
  SyntheticFilm synthetic = MakeSyntheticFilm(kPictureWidth, kPictureHeight, 0.4f, 9);
  LayeredImage film = WithoutHalves(std::move(synthetic.film));
  SplitIntoHalves(&film, nullptr);
  const auto picture = FilterFilm(film, "default", nullptr);
  ASSERT_TRUE(picture.ok()) << picture.status();
  const ConstColorView filtered = {(*picture)[0].view(), (*picture)[1].view(), (*picture)[2].view()};
  const ConstColorView truth = std::as_const(synthetic.truth).GetColor(layers::kBeauty);
  const double before = metrics::Mse255(std::as_const(film).GetColor(layers::kNoisy), truth, 1);
  EXPECT_LT(metrics::Mse255(filtered, truth, 1), 0.2 * before);
}

using Layers = std::vector<std::string_view>;

/// The filtered picture of a film without halves, a pixel of which is `value` in some of its layers.
Picture WithOutlier(const LayeredImage& clean, const Layers& layers, float value, int x, int y) {
  LayeredImage film(clean.width(), clean.height());
  for (const LayeredImage::Channel& channel : clean.channels())
    CopyPlane(channel.plane.view(), film.Add(channel.name));
  for (const std::string_view layer : layers) {
    for (const FloatView& channel : film.GetColor(layer)) channel.At(x, y) = value;
  }
  SplitIntoHalves(&film, nullptr);
  return *FilterFilm(film, "default", nullptr);
}

/// A picture of colours alone.
LayeredImage PlainFilm(const LayeredImage& film) {
  LayeredImage colors(film.width(), film.height());
  for (const auto& [name, c] : {std::pair("R", 0u), std::pair("G", 1u), std::pair("B", 2u)})
    CopyPlane(film.GetColor(layers::kNoisy)[c], colors.Add(name));
  auto plain = ReadForeignFilm("plain", colors, *FindFilmLayout("plain"));
  return std::move(plain->film);
}

void ExpectNoOtherMoves(const LayeredImage& film, const Layers& layers, std::pair<int, int> at,
                        const Picture& without) {
  constexpr float kMostMoved = 0.05f;  // a bright lamp changes what others count relative to the mean
  for (const float value : {4.0f, 30.0f, 1e4f, 1e30f}) {
    const auto& [x, y] = at;
    const Picture picture = WithOutlier(film, layers, value, x, y);
    float moved = 0;
    float least = 0;
    for (size_t c = 0; c < 3; ++c) {
      ForEachPixel(kPictureWidth, kPictureHeight, [&](int i, int j) {
        least = std::min(least, picture[c].At(i, j));
        if (std::abs(i - x) > 2 || std::abs(j - y) > 2)
          moved = std::max(moved, std::abs(picture[c].At(i, j) - without[c].At(i, j)));
      });
    }
    EXPECT_LT(moved, kMostMoved) << layers.back() << " of " << layers.size() << " " << value << " " << x;
    EXPECT_GE(least, 0) << layers.back() << " of " << layers.size() << " " << value << " " << x;
  }
}

TEST(SinglePicture, NoSinglePixelOfAnyBrightnessMovesOthers) {
  const LayeredImage film = WithoutHalves(MakeSyntheticFilm(kPictureWidth, kPictureHeight, 0.3f, 9).film);
  const Picture without = WithOutlier(film, {}, 0, 0, 0);
  std::pair at(90, 60);
  for (const Layers& layers :
       {Layers{layers::kNoisy}, Layers{layers::kDirect}, Layers{layers::kIndirect}, Layers{layers::kAlbedo},
        Layers{layers::kEmission}, Layers{layers::kNoisy, layers::kDirect},
        Layers{layers::kNoisy, layers::kIndirect}, Layers{layers::kNoisy, layers::kEmission}}) {
    ExpectNoOtherMoves(film, layers, at, without);
    at = {130 - at.first, 160 - at.second};
  }
}

TEST(SinglePicture, NoSinglePixelOfAPictureOfColorsMovesOthers) {
  const LayeredImage film =
      PlainFilm(WithoutHalves(MakeSyntheticFilm(kPictureWidth, kPictureHeight, 0.3f, 9).film));
  const Picture without = WithOutlier(film, {}, 0, 0, 0);
  for (const auto& at : {std::pair(40, 100), std::pair(90, 60)})
    ExpectNoOtherMoves(film, {layers::kNoisy}, at, without);
}

TEST(SinglePicture, IsTheSameForAnyPool) {
  const auto halves_by = [](TaskPool* pool) {
    LayeredImage film = WithoutHalves(MakeSyntheticFilm(kPictureWidth, kPictureHeight, 0.4f, 9).film);
    SplitIntoHalves(&film, pool);
    return film;
  };
  const LayeredImage alone = halves_by(nullptr);
  ShufflingPool pool(7);
  const LayeredImage shuffled = halves_by(&pool);
  for (const LayeredImage::Channel& channel : alone.channels()) {
    const ConstFloatView other = shuffled.Get(channel.name);
    for (int y = 0; y < kPictureHeight; ++y)
      EXPECT_TRUE(std::equal(other.Row(y), other.Row(y) + kPictureWidth, channel.plane.Row(y)))
          << channel.name;
  }
}

}  // namespace
}  // namespace lumifold::filter
