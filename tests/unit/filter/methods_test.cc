#include "filter/methods.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <utility>

#include "filter/baselines/baseline.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/metrics/metrics.h"
#include "is_finite.h"
#include "synthetic_film.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::filter {
namespace {

using ::testing::HasSubstr;

Picture Filter(const LayeredImage& film, std::string_view method = "default", TaskPool* pool = nullptr) {
  absl::StatusOr<Picture> result = FilterFilm(film, method, pool);
  EXPECT_TRUE(result.ok()) << result.status();
  return *std::move(result);
}

double ErrorOf(const ConstColorView& picture, const SyntheticFilm& synthetic) {
  return metrics::Mse255(picture, synthetic.truth.GetColor(layers::kBeauty));
}

double NoisyError(const SyntheticFilm& synthetic) {
  return ErrorOf(std::as_const(synthetic.film).GetColor(layers::kNoisy), synthetic);
}

void Fill(float value, FloatView plane) {
  for (int y = 0; y < plane.height(); ++y) std::fill_n(plane.Row(y), plane.width(), value);
}

void ExpectSamePixels(const Picture& a, const Picture& b) {
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < a[c].height(); ++y) {
      for (int x = 0; x < a[c].width(); ++x)
        ASSERT_EQ(a[c].At(x, y), b[c].At(x, y)) << c << ": " << x << "," << y;
    }
  }
}

TEST(FilterFilm, TakesOutMostOfStrongNoise) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(160, 120, 0.4f, 1);
  EXPECT_LT(ErrorOf(ViewOf(Filter(synthetic.film)), synthetic), 0.1 * NoisyError(synthetic));
}

TEST(FilterFilm, NeverMakesThePictureWorse) {
  for (const float noise : {1.0f, 0.3f, 0.1f, 0.03f, 0.01f, 0.003f}) {
    const SyntheticFilm synthetic = MakeSyntheticFilm(128, 96, noise, 2);
    EXPECT_LT(ErrorOf(ViewOf(Filter(synthetic.film)), synthetic), NoisyError(synthetic)) << noise;
  }
}

TEST(FilterFilm, ConvergesToTheInputAsNoiseVanishes) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(96, 72, 0.0f, 3);
  // The choice keeps a trace of the filtered picture: it shrinks shares by the variance of their terms,
  // whatever causes it.
  EXPECT_LT(ErrorOf(ViewOf(Filter(synthetic.film)), synthetic), 1e-4);
}

TEST(FilterFilm, KeepsAHardShadowThatGeometryAloneCannotSee) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(160, 120, 0.2f, 4);
  const Picture picture = Filter(synthetic.film);
  // One row of the floor, on both sides of the shadow's edges: dark stays dark.
  const ConstColorView truth = synthetic.truth.GetColor(layers::kBeauty);
  double worst = 0;
  for (int x = 0; x < 160; ++x) {
    worst = std::max(worst, std::abs(static_cast<double>(picture[0].At(x, 100) - truth[0].At(x, 100))));
  }
  EXPECT_LT(worst, 0.35);  // the step is up to 0.8
}

TEST(FilterFilm, GivesTheSameBitsForAnyPool) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(97, 131, 0.4f, 5);
  const Picture alone = Filter(synthetic.film);
  std::vector<std::unique_ptr<TaskPool>> pools;
  for (const int threads : {1, 2, 4}) pools.push_back(MakeTaskPool(threads));
  pools.push_back(std::make_unique<ShufflingPool>(7));
  for (const auto& pool : pools) ExpectSamePixels(Filter(synthetic.film, "default", pool.get()), alone);
}

TEST(FilterFilm, LeavesSkyExactlyAlone) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(96, 80, 0.4f, 6);
  const Picture picture = Filter(synthetic.film);
  const ConstColorView noisy = synthetic.film.GetColor(layers::kNoisy);
  for (int y = 0; y < 11; ++y) {
    for (int x = 0; x < 96; ++x) ASSERT_EQ(picture[1].At(x, y), noisy[1].At(x, y));
  }
}

/// Mean square difference of the pictures over columns [x0, x1), first channel.
double ColumnsError(const Plane& picture, ConstFloatView truth, int x0, int x1) {
  double sum = 0;
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = x0; x < x1; ++x) {
      const double difference = static_cast<double>(picture.At(x, y) - truth.At(x, y));
      sum += difference * difference;
    }
  }
  return sum / ((x1 - x0) * picture.height());
}

TEST(FilterFilm, FiltersWhatTheLayersDoNotExplain) {
  SyntheticFilm synthetic = MakeSyntheticFilm(128, 96, 0.1f, 14);
  LayeredImage& film = synthetic.film;
  std::mt19937 random(15);
  std::normal_distribution<float> noise(0.0f, 0.2f);
  ForEachPixel(128, 96, [&](int x, int y) {
    const float a = noise(random);
    const float b = noise(random);
    film.Get("noisy_a.R").At(x, y) += a;
    film.Get("noisy_b.R").At(x, y) += b;
    film.Get("noisy.R").At(x, y) += 0.5f * (a + b);
  });
  const ConstFloatView truth = std::as_const(synthetic.truth).Get("R");
  const Picture picture = Filter(film);
  const Picture noisy = Filter(film, "none");
  // Sky is never filtered: compare below it.
  EXPECT_LT(ColumnsError(picture[0], truth, 0, 128), 0.35 * ColumnsError(noisy[0], truth, 0, 128));
}

TEST(FilterFilm, LeavesALampExactlyAloneBesideNoisyReflections) {
  SyntheticFilm synthetic = MakeSyntheticFilm(128, 96, 0.1f, 17);
  LayeredImage& film = synthetic.film;
  const auto set = [&](const char* layer, int x, int y, float value) {
    for (const FloatView& channel : film.GetColor(layer)) channel.At(x, y) = value;
  };
  std::mt19937 random(18);
  std::normal_distribution<float> noise(0.0f, 0.2f);
  for (int y = 15; y < 96; ++y) {
    for (int x = 0; x < 128; ++x) {
      if (x >= 60 && x < 72) {
        film.Get(layers::kMask).At(x, y) = 0;
        for (const char* layer :
             {"direct", "direct_a", "direct_b", "indirect", "indirect_a", "indirect_b", "albedo"})
          set(layer, x, y, 0.0f);
        for (const char* layer : {"noisy", "noisy_a", "noisy_b", "emission"}) set(layer, x, y, 0.7f);
        continue;
      }
      const float a = noise(random);
      const float b = noise(random);
      film.Get("noisy_a.R").At(x, y) += a;
      film.Get("noisy_b.R").At(x, y) += b;
      film.Get("noisy.R").At(x, y) += 0.5f * (a + b);
    }
  }
  const Picture picture = Filter(film);
  for (int y = 20; y < 90; ++y) {
    for (int x = 61; x < 71; ++x) ASSERT_EQ(picture[0].At(x, y), 0.7f) << x << "," << y;
  }
}

TEST(FilterFilm, FiltersPixelsThatTheSurfaceCoversInPart) {
  SyntheticFilm synthetic = MakeSyntheticFilm(128, 96, 0.4f, 16);
  constexpr int kX0 = 60;
  constexpr int kX1 = 62;
  LayeredImage& film = synthetic.film;
  for (int y = 15; y < 96; ++y) {  // a black emitter covers half of each of these pixels
    for (int x = kX0; x < kX1; ++x) {
      film.Get(layers::kMask).At(x, y) = 0.5f;
      for (const std::string_view layer : {layers::kDirect, layers::kIndirect}) {
        for (const std::string& half : {std::string(layer), layers::HalfA(layer), layers::HalfB(layer)}) {
          for (const FloatView& channel : film.GetColor(half)) channel.At(x, y) *= 0.5f;
        }
      }
      for (const char* name : {"noisy", "noisy_a", "noisy_b"}) {
        for (const FloatView& channel : film.GetColor(name)) channel.At(x, y) *= 0.5f;
      }
      for (const FloatView& channel : synthetic.truth.GetColor(layers::kBeauty)) channel.At(x, y) *= 0.5f;
    }
  }
  const ConstFloatView truth = std::as_const(synthetic.truth).Get("R");
  const Picture picture = Filter(film);
  const Picture noisy = Filter(film, "none");
  EXPECT_LT(ColumnsError(picture[0], truth, kX0, kX1), 0.3 * ColumnsError(noisy[0], truth, kX0, kX1));
}

TEST(FilterFilm, NoneReturnsTheNoisyPictureExactly) {
  SyntheticFilm synthetic = MakeSyntheticFilm(31, 17, 0.4f, 7);
  synthetic.film.Get("noisy.R").At(3, 3) = std::numeric_limits<float>::infinity();
  LayeredImage only_noisy(31, 17);
  for (const std::string& name : layers::ColorChannels(layers::kNoisy)) {
    only_noisy.Add(name, Plane(31, 17));
    CopyPlane(std::as_const(synthetic.film).Get(name), only_noisy.Get(name));
  }
  const Picture picture = Filter(only_noisy, "none");
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < 17; ++y) {
      for (int x = 0; x < 31; ++x) {
        ASSERT_EQ(picture[c].At(x, y), std::as_const(synthetic.film).GetColor(layers::kNoisy)[c].At(x, y));
      }
    }
  }
}

TEST(FilterFilm, ScalesWithTheUnitOfLight) {
  const Picture plain = Filter(MakeSyntheticFilm(96, 64, 0.3f, 8).film);
  constexpr int kPixels = 96 * 64;
  double brightness = 0;
  ForEachPixel(96, 64, [&](int x, int y) { brightness += static_cast<double>(plain[0].At(x, y)) / kPixels; });
  for (const float factor : {1e-20f, 3e-6f, 7e5f, 1e20f, 0x1p40f}) {
    SyntheticFilm scaled = MakeSyntheticFilm(96, 64, 0.3f, 8);
    ScaleRadiance(factor, &scaled.film);
    const Picture picture = Filter(scaled.film);
    double squares = 0;
    double largest = 0;
    ForEachPixel(96, 64, [&](int x, int y) {
      const double expected = static_cast<double>(plain[0].At(x, y));
      const double value = static_cast<double>(picture[0].At(x, y)) / static_cast<double>(factor);
      const double off = std::abs(value - expected) / std::max(expected, brightness);
      squares += off * off;
      largest = std::max(largest, off);
    });
    // Any factor but a power of two changes the rounding of the film.
    EXPECT_LE(std::sqrt(squares / kPixels), 1e-5) << factor;
    EXPECT_LE(largest, factor == 0x1p40f ? 0.0 : 1e-4) << factor;
  }
}

TEST(FilterFilm, StaysFiniteOnAnySizeAndOnAllSky) {
  for (const auto& [width, height] : {std::pair{1, 1}, {1, 40}, {40, 1}, {2, 3}, {65, 1}}) {
    for (const std::string_view method : {"default", "paper"}) {
      EXPECT_TRUE(IsFinite(Filter(MakeSyntheticFilm(width, height, 0.3f, 9).film, method)))
          << width << "x" << height;
    }
  }
  SyntheticFilm sky = MakeSyntheticFilm(40, 30, 0.3f, 9);
  for (const std::string_view name : {layers::kMask, layers::kDistance}) Fill(0, sky.film.Get(name));
  const Picture picture = Filter(sky.film);
  EXPECT_TRUE(IsFinite(picture));
  EXPECT_EQ(picture[0].At(20, 20), std::as_const(sky.film).Get("noisy.R").At(20, 20));
}

/// One evenly lit surface: 0.75 of light on an albedo of 0.8.
LayeredImage FilmOfOneValue(int width, int height) {
  SyntheticFilm synthetic = MakeSyntheticFilm(width, height, 0.0f, 19);
  for (LayeredImage::Channel& channel : synthetic.film.channels()) {
    const auto is_of = [&](std::string_view layer) { return channel.name.rfind(layer, 0) == 0; };
    float value = 0;
    if (is_of(layers::kDirect)) value = 0.5f;
    if (is_of(layers::kIndirect)) value = 0.25f;
    if (is_of(layers::kAlbedo)) value = 0.8f;
    if (is_of(layers::kNoisy)) value = 0.6f;
    if (is_of(layers::kSamplesA) || is_of(layers::kSamplesB)) value = 8;
    if (is_of(layers::kNormalZ) || is_of(layers::kMask)) value = 1;
    if (is_of(layers::kDistance)) value = 4;
    Fill(value, channel.plane.view());
  }
  return std::move(synthetic.film);
}

TEST(FilterFilm, KeepsAFilmOfOneValue) {
  for (const std::string_view method : {"default", "paper"}) {
    const Picture picture = Filter(FilmOfOneValue(40, 30), method);
    for (const Plane& plane : picture) {
      for (int y = 0; y < 30; ++y) {
        for (int x = 0; x < 40; ++x)
          ASSERT_NEAR(plane.At(x, y), 0.6f, 1e-5f) << method << " " << x << "," << y;
      }
    }
  }
}

TEST(FilterFilm, KeepsTheOnlyPixelThatHitsASurface) {
  for (const std::string_view method : {"default", "paper"}) {
    SyntheticFilm synthetic = MakeSyntheticFilm(40, 30, 0.3f, 20);
    LayeredImage& film = synthetic.film;
    const float distance = film.Get(layers::kDistance).At(17, 20);
    for (const std::string_view name : {layers::kMask, layers::kDistance}) Fill(0, film.Get(name));
    film.Get(layers::kMask).At(17, 20) = 1;
    film.Get(layers::kDistance).At(17, 20) = distance;
    const Picture picture = Filter(film, method);
    const ConstColorView noisy = std::as_const(film).GetColor(layers::kNoisy);
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(picture[c].At(17, 20), noisy[c].At(17, 20), 1e-3f * noisy[c].At(17, 20)) << method;
    }
    EXPECT_EQ(picture[0].At(16, 20), noisy[0].At(16, 20)) << method;
  }
}

TEST(FilterFilm, IsGuidedByLightAloneWhereFeaturesAreConstant) {
  SyntheticFilm synthetic = MakeSyntheticFilm(128, 96, 0.3f, 21);
  LayeredImage& film = synthetic.film;
  for (const std::string_view name : {layers::kNormalX, layers::kNormalY}) Fill(0, film.Get(name));
  for (const std::string_view name : {layers::kNormalZ, layers::kDistance, layers::kMask})
    Fill(1, film.Get(name));
  const Picture picture = Filter(film);
  EXPECT_TRUE(IsFinite(picture));
  EXPECT_LT(ErrorOf(ViewOf(picture), synthetic), 0.2 * NoisyError(synthetic));
}

TEST(FilterFilm, StaysFiniteWhateverTheFilmHolds) {
  for (const float poison : {NAN, INFINITY, -INFINITY, -0.5f, -1e38f, 3e38f}) {
    for (const char* channel :
         {"direct_a.R", "indirect_b.G", "noisy.R", "albedo.B", "N.X", "distance.Z", "glossy.R"}) {
      SyntheticFilm synthetic = MakeSyntheticFilm(48, 40, 0.3f, 10);
      for (int i = 0; i < 12; ++i) synthetic.film.Get(channel).At(3 * i, 2 * i + 8) = poison;
      EXPECT_TRUE(IsFinite(Filter(synthetic.film))) << channel << " " << poison;
    }
  }
}

TEST(FilterFilm, WorksWithOneSampleInOneHalf) {
  SyntheticFilm synthetic = MakeSyntheticFilm(128, 96, 0.4f, 11);
  LayeredImage& film = synthetic.film;
  Fill(0, film.Get(layers::kSamplesB));
  for (const std::string_view layer : layers::kHalved) {
    for (size_t c = 0; c < 3; ++c) {
      CopyPlane(std::as_const(film).GetColor(layers::HalfA(layer))[c], film.GetColor(layer)[c]);
      Fill(0, film.GetColor(layers::HalfB(layer))[c]);
    }
  }
  EXPECT_LT(ErrorOf(ViewOf(Filter(film)), synthetic), 0.3 * NoisyError(synthetic));
}

TEST(FilterFilm, NamesAMissingChannelAndAnUnknownMethod) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(8, 8, 0.1f, 12);
  LayeredImage partial(8, 8);
  for (const LayeredImage::Channel& channel : synthetic.film.channels()) {
    if (channel.name != "indirect_b.G") partial.Add(channel.name, channel.plane.Clone());
  }
  const absl::Status missing = FilterFilm(partial, "default", nullptr).status();
  EXPECT_EQ(missing.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(missing.message()), HasSubstr("indirect_b.G"));
  LayeredImage edges(kSubSamples, 1);
  edges.Add(layers::kPixelX);
  const absl::Status no_edges = FilterFilm(synthetic.film, "default", nullptr, &edges).status();
  EXPECT_EQ(no_edges.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(no_edges.message()), HasSubstr("pixel.Y"));
  const absl::Status unknown = FilterFilm(synthetic.film, "magic", nullptr).status();
  EXPECT_EQ(unknown.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(unknown.message()), HasSubstr("magic"));
}

TEST(FilterFilm, NamesParametersOfAMethodThatTakesNone) {
  EXPECT_THAT(std::string(CheckMethod("default:sigma=1").message()),
              HasSubstr("default takes no parameters"));
  EXPECT_TRUE(CheckMethod("guided:radius=3").ok());
}

TEST(Methods, AreOursThenTheBaselines) {
  std::vector<std::string> names;
  for (const MethodInfo& method : Methods()) names.push_back(method.name);
  ASSERT_EQ(names.size(), 2 + Baselines().size());
  EXPECT_EQ(std::vector<std::string>(names.begin(), names.begin() + 2),
            (std::vector<std::string>{"default", "none"}));
  for (size_t i = 0; i < Baselines().size(); ++i) EXPECT_EQ(names[2 + i], Baselines()[i].info.name);
}

TEST(FilterFilm, NeedsThePlainPictureAloneForMethodsThatSaySo) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(24, 20, 0.3f, 13);
  LayeredImage plain(24, 20);
  for (const std::string& name : layers::ColorChannels(layers::kNoisy))
    plain.Add(name, Clone(synthetic.film.Get(name)));
  for (const MethodInfo& method : Methods()) {
    const absl::StatusOr<Picture> picture = FilterFilm(plain, method.name, nullptr);
    EXPECT_EQ(picture.ok(), !method.uses_auxiliary) << method.name;
    if (!picture.ok()) continue;
    const Picture whole = *FilterFilm(synthetic.film, method.name, nullptr);
    EXPECT_TRUE(std::equal((*picture)[1].Row(7), (*picture)[1].Row(7) + 24, whole[1].Row(7))) << method.name;
  }
}

TEST(FilterFilm, EveryListedMethodRuns) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(40, 30, 0.3f, 13);
  for (const MethodInfo& method : Methods())
    EXPECT_TRUE(FilterFilm(synthetic.film, method.name, nullptr).ok()) << method.name;
}

/// Sum of squares over a picture, less `truth` unless that is empty.
double SumOfSquares(const Picture& picture, const LayeredImage* truth) {
  double sum = 0;
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(picture[c].width(), picture[c].height(), [&](int x, int y) {
      const float off = truth != nullptr ? truth->GetColor(layers::kBeauty)[c].At(x, y) : 0.0f;
      sum += std::pow(static_cast<double>(picture[c].At(x, y) - off), 2);
    });
  }
  return sum;
}

TEST(FilterFilmWithDeviation, TellsHowFarThePictureIsOff) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(160, 120, 0.4f, 1);
  for (const std::string_view method : {"default", "none"}) {
    const auto filtered = FilterFilmWithDeviation(synthetic.film, method, nullptr);
    ASSERT_TRUE(filtered.ok()) << filtered.status();
    ExpectSamePixels(filtered->picture, Filter(synthetic.film, method));
    const double error = SumOfSquares(filtered->picture, &synthetic.truth);
    const double variance = SumOfSquares(filtered->deviation, nullptr);
    // Of the noisy picture the variance is the error; the filter's halves share some of it.
    EXPECT_GT(variance, (method == "none" ? 0.95 : 0.3) * error) << method;
    EXPECT_LT(variance, 1.05 * error) << method;
  }
}

TEST(FilterFilmWithDeviation, TellsAsMuchInBlocks) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(384, 256, 0.4f, 7);
  const auto whole = FilterFilmWithDeviation(synthetic.film, "default", nullptr);
  const auto blocks =
      FilterFilmWithDeviation(synthetic.film, "default", nullptr, nullptr, nullptr, FilterPurpose::kPicture,
                              {.core = 128, .margin = 64, .fade = 32, .whole = 0});
  ASSERT_TRUE(whole.ok() && blocks.ok());
  EXPECT_LT(SumOfSquares(blocks->picture, &synthetic.truth),
            1.1 * SumOfSquares(whole->picture, &synthetic.truth));
  EXPECT_NEAR(SumOfSquares(blocks->deviation, nullptr) / SumOfSquares(whole->deviation, nullptr), 1, 0.2);
}

TEST(FilterFilmWithDeviation, LeavesOutAStageToEstimate) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(160, 120, 0.4f, 1);
  const auto estimate =
      FilterFilmWithDeviation(synthetic.film, "default", nullptr, nullptr, nullptr, FilterPurpose::kEstimate);
  ASSERT_TRUE(estimate.ok()) << estimate.status();
  const double error = SumOfSquares(estimate->picture, &synthetic.truth);
  EXPECT_GT(error, SumOfSquares(Filter(synthetic.film, "default"), &synthetic.truth));
  const double variance = SumOfSquares(estimate->deviation, nullptr);
  EXPECT_GT(variance, 0.3 * error) << "of the picture that was made";
  EXPECT_LT(variance, 1.05 * error);
}

TEST(FilterFilmWithDeviation, NamesTheMethodsThatKnowIt) {
  EXPECT_TRUE(CheckDeviation("default").ok());
  EXPECT_TRUE(CheckDeviation("none").ok());
  const absl::Status status = CheckDeviation("bilateral:sigma_s=4");
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("\"bilateral\" does not tell its error"));
  EXPECT_THAT(std::string(status.message()), HasSubstr("default, none"));
  EXPECT_THAT(std::string(CheckDeviation("no").message()), HasSubstr("no method is named"));
}

TEST(FilterFilmWithDeviation, NeedsTheHalvesOfThePicture) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(24, 20, 0.3f, 13);
  LayeredImage plain(24, 20);
  for (const std::string& name : layers::ColorChannels(layers::kNoisy))
    plain.Add(name, Clone(synthetic.film.Get(name)));
  const absl::Status status = FilterFilmWithDeviation(plain, "none", nullptr).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("samples_a"));
}

}  // namespace
}  // namespace lumifold::filter
