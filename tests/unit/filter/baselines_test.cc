#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "filter/baselines/baseline.h"
#include "filter/baselines/bilateral.h"
#include "filter/baselines/guided.h"
#include "filter/baselines/non_local_means.h"
#include "filter/baselines/patch_regression.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "filter/methods.h"
#include "filter/metrics/metrics.h"
#include "synthetic_film.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::filter {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Picture Filter(const Baseline& baseline, const LayeredImage& film, TaskPool* pool = nullptr) {
  absl::StatusOr<Picture> picture = FilterFilm(film, baseline.info.name, pool);
  EXPECT_TRUE(picture.ok()) << picture.status();
  return *std::move(picture);
}

Planes RandomPlanes(size_t count, int width, int height, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  Planes planes = MakePlanes(count, width, height);
  for (Plane& plane : planes) {
    ForEachPixel(width, height, [&](int x, int y) { plane.At(x, y) = uniform(random); });
  }
  return planes;
}

/// A film of one evenly lit wall: C = (0.6 + 0.2) * 0.5.
LayeredImage OneValueFilm() {
  LayeredImage film = std::move(MakeSyntheticFilm(28, 20, 0.0f, 1).film);
  for (LayeredImage::Channel& channel : film.channels()) {
    const std::string& name = channel.name;
    const auto is = [&](std::string_view layer) { return name.rfind(std::string(layer), 0) == 0; };
    float value = 0;
    if (is("noisy")) value = 0.4f;
    if (is("direct")) value = 0.6f;
    if (is("indirect")) value = 0.2f;
    if (is("albedo")) value = 0.5f;
    if (is("samples")) value = 8;
    if (name == "N.Z" || is("mask")) value = 1;
    if (is("distance")) value = 2;
    channel.plane.Fill(value);
  }
  return film;
}

TEST(Baseline, KeepsAPictureOfOneValue) {
  const LayeredImage film = OneValueFilm();
  for (const Baseline& baseline : Baselines()) {
    const Picture picture = Filter(baseline, film);
    for (const Plane& plane : picture) {
      for (int y = 0; y < film.height(); ++y) {
        for (int x = 0; x < film.width(); ++x)
          ASSERT_NEAR(plane.At(x, y), 0.4f, 2e-5f) << baseline.info.name << ": " << x << "," << y;
      }
    }
  }
}

TEST(Baseline, TakesNoiseOut) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(96, 72, 0.6f, 5);
  const ConstColorView truth = synthetic.truth.GetColor(layers::kBeauty);
  const double noisy = metrics::Mse255(synthetic.film.GetColor(layers::kNoisy), truth);
  for (const Baseline& baseline : Baselines()) {
    const Picture picture = Filter(baseline, synthetic.film);
    const double error = metrics::Mse255(ViewOf(picture), truth);
    EXPECT_LT(error, noisy) << baseline.info.name;
  }
}

TEST(Baseline, GivesTheSameBitsForAnyPool) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(28, 70, 0.4f, 6);
  for (const Baseline& baseline : Baselines()) {
    ShufflingPool pool(9);
    const Picture alone = Filter(baseline, synthetic.film);
    const Picture shuffled = Filter(baseline, synthetic.film, &pool);
    for (size_t c = 0; c < 3; ++c) {
      for (int y = 0; y < 70; ++y) {
        for (int x = 0; x < 28; ++x) ASSERT_EQ(alone[c].At(x, y), shuffled[c].At(x, y)) << baseline.info.name;
      }
    }
  }
}

TEST(Baseline, StaysFiniteWhateverTheFilmHolds) {
  constexpr float kBad[] = {std::numeric_limits<float>::quiet_NaN(),
                            std::numeric_limits<float>::infinity(),
                            -std::numeric_limits<float>::infinity(),
                            1e30f,
                            -5.0f,
                            0.0f};
  SyntheticFilm synthetic = MakeSyntheticFilm(37, 29, 0.5f, 7);
  std::mt19937 random(3);
  for (LayeredImage::Channel& channel : synthetic.film.channels()) {
    for (int i = 0; i < 40; ++i) {
      const int x = static_cast<int>(random() % 37);
      const int y = static_cast<int>(random() % 29);
      channel.plane.At(x, y) = kBad[random() % std::size(kBad)];
    }
  }
  for (const Baseline& baseline : Baselines()) {
    for (const Plane& plane : Filter(baseline, synthetic.film)) {
      for (int y = 0; y < plane.height(); ++y) {
        for (int x = 0; x < plane.width(); ++x)
          ASSERT_TRUE(std::isfinite(plane.At(x, y))) << baseline.info.name << ": " << x << "," << y;
      }
    }
  }
}

TEST(Baseline, TakesAPictureOfOnePixel) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(1, 1, 0.3f, 8);
  for (const Baseline& baseline : Baselines())
    EXPECT_TRUE(std::isfinite(Filter(baseline, synthetic.film)[0].At(0, 0))) << baseline.info.name;
}

TEST(Baseline, RunsAtBothLimitsOfEachParameter) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(20, 16, 0.3f, 9);
  for (const Baseline& baseline : Baselines()) {
    for (size_t i = 0; i < baseline.info.parameters.size(); ++i) {
      for (const float value : {baseline.info.parameters[i].least, baseline.info.parameters[i].most}) {
        std::vector<float> values = DefaultsOf(baseline.info);
        values[i] = value;
        for (const Plane& plane : baseline.filter({synthetic.film}, values, nullptr)) {
          for (int y = 0; y < plane.height(); ++y) {
            for (int x = 0; x < plane.width(); ++x)
              ASSERT_TRUE(std::isfinite(plane.At(x, y))) << baseline.info.name << " " << value;
          }
        }
      }
    }
  }
}

TEST(Baseline, HasDefaultsAndGridsWithinItsLimits) {
  for (const Baseline& baseline : Baselines()) {
    for (const MethodParameter& p : baseline.info.parameters) {
      EXPECT_THAT(p.grid, testing::Each(testing::AllOf(testing::Ge(p.least), testing::Le(p.most)))) << p.name;
      EXPECT_THAT(p.grid, testing::Contains(p.default_value)) << baseline.info.name << ": " << p.name;
    }
  }
}

const MethodInfo& Bilateral() {
  const auto is_it = [](const Baseline& baseline) { return baseline.info.name == "bilateral"; };
  return std::find_if(Baselines().begin(), Baselines().end(), is_it)->info;
}

TEST(MethodParameters, KeepDefaultsThatAreNotNamed) {
  const MethodInfo& bilateral = Bilateral();
  EXPECT_THAT(*ParseParameters(bilateral, ""), ElementsAre(8, 0.15f));
  EXPECT_THAT(*ParseParameters(bilateral, "sigma_r=0.5"), ElementsAre(8, 0.5f));
  EXPECT_THAT(*ParseParameters(bilateral, "sigma_r=0.5,sigma_s=2"), ElementsAre(2, 0.5f));
  EXPECT_EQ(FormatParameters(bilateral, {2, 0.5f}), "sigma_s=2,sigma_r=0.5");
}

TEST(MethodParameters, NameWhatIsWrong) {
  const MethodInfo& bilateral = Bilateral();
  const auto message = [&](std::string_view text) {
    return std::string(ParseParameters(bilateral, text).status().message());
  };
  EXPECT_THAT(message("sigma=1"), HasSubstr("no parameter 'sigma'; it has: sigma_s, sigma_r"));
  EXPECT_THAT(message("sigma_s=wide"), HasSubstr("not 'wide'"));
  EXPECT_THAT(message("sigma_s=nan"), HasSubstr("not 'nan'"));
  EXPECT_THAT(message("sigma_s=1e9"), HasSubstr("from 0.5 to 32"));
  EXPECT_THAT(message("sigma_s=2,sigma_s=3"), HasSubstr("twice"));
  EXPECT_THAT(message("sigma_s"), HasSubstr("not ''"));
}

TEST(MethodParameters, SpanTheirGrid) {
  const MethodInfo method = {.name = "x",
                             .summary = "",
                             .source = "",
                             .parameters = {{"a", "", 1, {1, 2}, 0, 9}, {"b", "", 3, {3, 4}, 0, 9}}};
  EXPECT_THAT(GridOf(method),
              ElementsAre(ElementsAre(1, 3), ElementsAre(1, 4), ElementsAre(2, 3), ElementsAre(2, 4)));
}

TEST(MethodInfo, IsListedForPeopleAndForPrograms) {
  const MethodInfo plain = {
      .name = "a", .summary = "a \"plain\" one", .source = "x", .parameters = {}, .uses_auxiliary = false};
  const MethodInfo steered = {
      .name = "b", .summary = "y", .source = "z", .parameters = {{"k", "strength", 0.5f, {0.5f}, 0.25f, 8}}};
  EXPECT_EQ(MethodsAsJson({plain, steered}),
            "{\"name\": \"a\", \"summary\": \"a \\\"plain\\\" one\", \"source\": \"x\", \"auxiliary\": "
            "false, \"parameters\": []}\n"
            "{\"name\": \"b\", \"summary\": \"y\", \"source\": \"z\", \"auxiliary\": true, \"parameters\": "
            "[{\"name\": \"k\", "
            "\"summary\": "
            "\"strength\", \"default\": 0.5, \"least\": 0.25, \"most\": 8}]}\n");
  EXPECT_THAT(MethodTable({plain, steered}), HasSubstr("k=0.5 (0.25 to 8): strength\n"));
  EXPECT_THAT(MethodTable({plain}), HasSubstr("needs the plain picture alone\n"));
  EXPECT_THAT(MethodTable({steered}), testing::Not(HasSubstr("plain picture")));
  EXPECT_EQ(MethodNames({plain}), "a");
  EXPECT_EQ(MethodNames({plain, steered, plain}), "a, b and a");
}

TEST(BilateralFilter, AgreesWithTheSumOverEachPixelsNeighbours) {
  constexpr int kWidth = 23;
  constexpr int kHeight = 17;
  constexpr float kSigma = 1.5f;
  constexpr int kRadius = 4;  // ceil(2.5 * 1.5)
  const Planes signal = RandomPlanes(1, kWidth, kHeight, 1);
  const Planes guide = RandomPlanes(2, kWidth, kHeight, 2);
  Planes mask = RandomPlanes(1, kWidth, kHeight, 3);
  for (int x = 0; x < kWidth; ++x) mask[0].At(x, 5) = 0;
  const Planes filtered = BilateralFilter(signal, guide, mask[0].view(), kSigma, nullptr);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      double sum = 0;
      double total = 0;
      for (int j = std::max(0, y - kRadius); j <= std::min(kHeight - 1, y + kRadius); ++j) {
        for (int i = std::max(0, x - kRadius); i <= std::min(kWidth - 1, x + kRadius); ++i) {
          double distance = ((i - x) * (i - x) + (j - y) * (j - y)) / static_cast<double>(kSigma * kSigma);
          for (const Plane& u : guide) distance += std::pow(static_cast<double>(u.At(x, y) - u.At(i, j)), 2);
          const double w = static_cast<double>(mask[0].At(i, j)) * std::exp(-0.5 * distance);
          sum += w * static_cast<double>(signal[0].At(i, j));
          total += w;
        }
      }
      ASSERT_NEAR(static_cast<double>(filtered[0].At(x, y)), sum / total, 1e-5) << x << "," << y;
    }
  }
}

/// So small against the differences of RandomPlanes() that weights differ: within the noise all are 1.
Planes RandomVariances(size_t count, int width, int height, uint32_t seed) {
  Planes planes = RandomPlanes(count, width, height, seed);
  for (Plane& plane : planes) ForEachPixel(width, height, [&](int x, int y) { plane.At(x, y) *= 0.1f; });
  return planes;
}

/// The weight of q for p, from its definition.
double SlowWeight(const Planes& guide, const Planes& variance, const NonLocalMeansParams& params, int px,
                  int py, int qx, int qy) {
  const auto at = [](const Plane& plane, int x, int y) {
    return static_cast<double>(
        plane.At(std::clamp(x, 0, plane.width() - 1), std::clamp(y, 0, plane.height() - 1)));
  };
  double sum = 0;
  int count = 0;
  for (size_t c = 0; c < guide.size(); ++c) {
    for (int j = -params.patch_radius; j <= params.patch_radius; ++j) {
      for (int i = -params.patch_radius; i <= params.patch_radius; ++i) {
        const double difference = at(guide[c], px + i, py + j) - at(guide[c], qx + i, qy + j);
        const double vp = at(variance[c], px + i, py + j);
        const double vq = at(variance[c], qx + i, qy + j);
        const double k2 = static_cast<double>(params.strength) * static_cast<double>(params.strength);
        sum += std::min(1e4, (difference * difference - vp - std::min(vp, vq)) / (1e-7 + k2 * (vp + vq)));
        ++count;
      }
    }
  }
  return std::exp(-std::max(0.0, sum / count));
}

TEST(NonLocalMeans, AgreesWithTheSumOverPatches) {
  constexpr int kWidth = 19;
  constexpr int kHeight = 21;  // more than one strip
  const NonLocalMeansParams params = {.search_radius = 3, .patch_radius = 2, .strength = 0.7f};
  const Planes signal = RandomPlanes(1, kWidth, kHeight, 4);
  for (const size_t guides : {size_t{1}, size_t{3}}) {
    const Planes guide = RandomPlanes(guides, kWidth, kHeight, 5);
    const Planes variance = RandomVariances(guides, kWidth, kHeight, 6);
    const Planes filtered = NonLocalMeans(signal, guide, variance, params, nullptr);
    ForEachPixel(kWidth, kHeight, [&](int x, int y) {
      double sum = 0;
      double total = 0;
      for (int j = std::max(0, y - 3); j <= std::min(kHeight - 1, y + 3); ++j) {
        for (int i = std::max(0, x - 3); i <= std::min(kWidth - 1, x + 3); ++i) {
          const double w = SlowWeight(guide, variance, params, x, y, i, j);
          sum += w * static_cast<double>(signal[0].At(i, j));
          total += w;
        }
      }
      ASSERT_NEAR(static_cast<double>(filtered[0].At(x, y)), sum / total, 1e-4) << x << "," << y;
    });
  }
}

/// Solves a x = b for a symmetric positive a, by elimination.
std::vector<double> Solve(std::vector<std::vector<double>> a, std::vector<double> b) {
  const size_t n = b.size();
  for (size_t i = 0; i < n; ++i) {
    for (size_t j = i + 1; j < n; ++j) {
      const double factor = a[j][i] / a[i][i];
      for (size_t k = i; k < n; ++k) a[j][k] -= factor * a[i][k];
      b[j] -= factor * b[i];
    }
  }
  for (size_t i = n; i-- > 0;) {
    for (size_t k = i + 1; k < n; ++k) b[i] -= a[i][k] * b[k];
    b[i] /= a[i][i];
  }
  return b;
}

/// The oracle of PatchRegression: fits one window at a time and averages the predictions.
std::vector<double> SlowPatchRegression(const RegressionInput& input) {
  const int width = input.image[0].width();
  const int height = input.image[0].height();
  const NonLocalMeansParams params = {.search_radius = 9, .patch_radius = 3, .strength = input.strength};
  std::vector<double> sums(static_cast<size_t>(width * height), 0.0);
  std::vector<double> totals = sums;
  for (int p = 0; p < width * height; ++p) {
    const int px = p % width;
    const int py = p / width;
    const auto columns = [&](int x, int y) {
      const Plane& f = input.features[0];
      return std::array<double, 4>{1, (x - px) / 9.0, (y - py) / 9.0,
                                   static_cast<double>(f.At(x, y) - f.At(px, py))};
    };
    std::vector<std::vector<double>> normal(4, std::vector<double>(4, 0.0));
    std::vector<double> right(4, 0.0);
    const auto for_window = [&](absl::FunctionRef<void(int, int, double)> visit) {
      for (int y = std::max(0, py - 9); y < std::min(height, py + 10); ++y) {
        for (int x = std::max(0, px - 9); x < std::min(width, px + 10); ++x)
          visit(x, y, SlowWeight(input.guide, input.variance, params, px, py, x, y));
      }
    };
    for_window([&](int x, int y, double w) {
      const auto column = columns(x, y);
      for (size_t i = 0; i < 4; ++i) {
        for (size_t j = 0; j < 4; ++j) normal[i][j] += w * column[i] * column[j];
        right[i] += w * column[i] * static_cast<double>(input.image[0].At(x, y));
      }
    });
    for (size_t i = 1; i < 4; ++i) normal[i][i] += 1e-5 * normal[0][0];
    const std::vector<double> fit = Solve(normal, right);
    for_window([&](int x, int y, double w) {
      const auto column = columns(x, y);
      for (size_t i = 0; i < 4; ++i) sums[static_cast<size_t>(y * width + x)] += w * column[i] * fit[i];
      totals[static_cast<size_t>(y * width + x)] += w;
    });
  }
  for (size_t i = 0; i < sums.size(); ++i) sums[i] /= totals[i];
  return sums;
}

TEST(PatchRegression, AgreesWithWindowsFittedOneByOne) {
  constexpr int kWidth = 35;  // more than one tile
  constexpr int kHeight = 22;
  const Planes image = RandomPlanes(3, kWidth, kHeight, 10);
  const Planes guide = RandomPlanes(3, kWidth, kHeight, 11);
  const Planes variance = RandomVariances(3, kWidth, kHeight, 12);
  const Planes features = RandomPlanes(1, kWidth, kHeight, 13);
  const RegressionInput input = {image, guide, variance, features, 0.8f};
  const Planes fitted = PatchRegression(input, nullptr);
  const std::vector<double> expected = SlowPatchRegression(input);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      ASSERT_NEAR(static_cast<double>(fitted[0].At(x, y)), expected[static_cast<size_t>(y * kWidth + x)],
                  1e-4)
          << x << "," << y;
    }
  }
}

TEST(PatchRegression, KeepsAPictureThatFollowsItsFeatures) {
  constexpr int kSize = 40;
  const Planes features = RandomPlanes(2, kSize, kSize, 14);
  Planes image = MakePlanes(3, kSize, kSize);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(kSize, kSize, [&](int x, int y) {
      image[c].At(x, y) = 2 * features[0].At(x, y) - features[1].At(x, y) + 0.02f * static_cast<float>(x + 3);
    });
  }
  Planes variance = MakePlanes(3, kSize, kSize);
  for (Plane& plane : variance) plane.Fill(1.0f);
  const Planes fitted = PatchRegression({image, image, variance, features, 1}, nullptr);
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x)
      ASSERT_NEAR(fitted[1].At(x, y), image[1].At(x, y), 5e-3f) << x << "," << y;
  }
}

TEST(GuidedFilter, AgreesWithWindowsFittedOneByOne) {
  constexpr int kWidth = 15;
  constexpr int kHeight = 13;
  constexpr int kRadius = 2;
  constexpr double kEpsilon = 0.05;
  const Planes signal = RandomPlanes(1, kWidth, kHeight, 7);
  const Planes guide = RandomPlanes(1, kWidth, kHeight, 8);
  Plane mask = MakePlane(kWidth, kHeight, 1.0f);
  const Planes filtered = GuidedFilter(signal, guide, mask.view(), kRadius, kEpsilon, nullptr);
  const auto window_mean = [&](int x, int y, absl::FunctionRef<double(int, int)> value) {
    double sum = 0;
    int count = 0;
    for (int j = std::max(0, y - kRadius); j <= std::min(kHeight - 1, y + kRadius); ++j) {
      for (int i = std::max(0, x - kRadius); i <= std::min(kWidth - 1, x + kRadius); ++i, ++count)
        sum += value(i, j);
    }
    return sum / count;
  };
  const auto g = [&](int x, int y) { return static_cast<double>(guide[0].At(x, y)); };
  const auto p = [&](int x, int y) { return static_cast<double>(signal[0].At(x, y)); };
  const auto slope = [&](int x, int y) {
    const double gm = window_mean(x, y, g);
    const double pm = window_mean(x, y, p);
    const double gg = window_mean(x, y, [&](int i, int j) { return (g(i, j) - gm) * (g(i, j) - gm); });
    return window_mean(x, y, [&](int i, int j) { return (g(i, j) - gm) * (p(i, j) - pm); }) / (gg + kEpsilon);
  };
  const auto offset = [&](int x, int y) { return window_mean(x, y, p) - slope(x, y) * window_mean(x, y, g); };
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double expected = window_mean(x, y, slope) * g(x, y) + window_mean(x, y, offset);
      ASSERT_NEAR(static_cast<double>(filtered[0].At(x, y)), expected, 1e-4) << x << "," << y;
    }
  }
}

TEST(GuidedFilter, KeepsASignalThatFollowsItsGuide) {
  const Planes guide = RandomPlanes(2, 30, 20, 9);
  Plane mask = MakePlane(30, 20, 1.0f);
  Planes signal = MakePlanes(1, 30, 20);
  ForEachPixel(30, 20,
               [&](int x, int y) { signal[0].At(x, y) = 2 * guide[0].At(x, y) - guide[1].At(x, y) + 3; });
  const Planes filtered = GuidedFilter(signal, guide, mask.view(), 4, 1e-6, nullptr);
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x < 30; ++x) ASSERT_NEAR(filtered[0].At(x, y), signal[0].At(x, y), 1e-3f);
  }
}

}  // namespace
}  // namespace lumifold::filter
