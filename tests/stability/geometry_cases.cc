// Shapes that are hard to filter: thin, almost coincident, or seen at a grazing angle.
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>

#include "filter/image/planes.h"
#include "tests/charts/metrics/seeds.h"
#include "tests/stability/case.h"

namespace lumifold::stability {
namespace {

using Figures = std::vector<double>;

constexpr int kSize = 128;
constexpr float kMiddle = kSize / 2.0f;

Surface Lit(float direct, float distance = 5) {
  Surface s;
  s.direct = Gray(direct);
  s.distance = distance;
  return s;
}

Surface Sky(float emission) {
  Surface s;
  s.object = 0;
  s.emission = Gray(emission);
  return s;
}

DrawnFilm Draw(const Drawing& drawing, const Sampling& sampling = {}) {
  return DrawFilm(kSize, kSize, drawing, sampling);
}

/// Shift of the mean of selected pixels by the filter, over the step between the two lights.
double Bleed(const Views& v, float step, Where where) {
  return std::abs(MeanOf(v.filtered, where) - MeanOf(v.noisy, where)) / static_cast<double>(step);
}

float BesidePole(float x, float y) { return x - kMiddle - 0.03f * (y - kMiddle); }

absl::StatusOr<Finding> Pole(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float y) {
    if (std::abs(BesidePole(x, y)) > 1) return Lit(0.8f, 10);
    Surface pole = Lit(0.2f, 4);
    pole.object = 2;
    return pole;
  });
  return Judge(trial, drawn, [](const Views& v) {
    const auto on_pole = [](int x, int y) {
      return std::abs(BesidePole(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f)) < 1;
    };
    return Figures{ErrorLeft(v, on_pole)};
  });
}

constexpr float kWireSpacing = 9;

bool IsWire(float x, float y) {
  const float across = (x + 0.37f * y) / std::sqrt(1 + 0.37f * 0.37f);
  return std::abs(across - kWireSpacing * std::round(across / kWireSpacing)) < 0.5f;
}

Surface WireAt(float x, float y) {
  if (!IsWire(x, y)) return Lit(0.8f, 20);
  Surface wire = Lit(0.3f, 3);
  wire.object = 2;
  wire.normal = {0.8f, 0, 0.6f};
  wire.albedo = Gray(0.2f);
  return wire;
}

absl::StatusOr<Finding> Wires(const Trial& trial) {
  Sampling sampling;
  sampling.samples = 64;
  const Picture by_sub_samples = Draw(WireAt, sampling).truth;  // of 4x4 points, without noise
  sampling.truth_grid = 16;
  const DrawnFilm drawn = Draw(WireAt, sampling);
  return Judge(trial, drawn, [&](const Views& v) {
    const auto covered = [&](int x, int y) {
      return by_sub_samples[0].At(x, y) < 0.79f && by_sub_samples[0].At(x, y) > 0.07f;
    };
    const double msaa = LinearError(ViewOf(by_sub_samples), v.truth, covered);
    return Figures{std::sqrt(LinearError(v.filtered, v.truth, covered) / msaa)};
  });
}

constexpr float kHorizon = 19.5f;

absl::StatusOr<Finding> GrazingFloor(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float y) {
    if (y < kHorizon + 0.5f) return Sky(0.7f);
    const float z = 100 / (y - kHorizon);
    const float across = (x - kMiddle) * z / 100;
    Surface s = Lit(0.2f + 0.6f / (1 + z * z / 400) + 0.1f * std::sin(across), z);
    s.normal = {0, 1, 0};
    return s;
  });
  return Judge(trial, drawn, [](const Views& v) {
    return Figures{ErrorLeft(v, [](int, int y) { return y >= 20 && y < 56; })};
  });
}

absl::StatusOr<Finding> ParallelPlanes(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float) {
    Surface s = x < kMiddle ? Lit(0.8f, 5) : Lit(0.4f, 5.05f);
    s.object = x < kMiddle ? 1 : 2;
    return s;
  });
  return Judge(trial, drawn, [](const Views& v) {
    const double left = Bleed(v, 0.4f, [](int x, int) { return x >= 56 && x < 64; });
    const double right = Bleed(v, 0.4f, [](int x, int) { return x >= 64 && x < 72; });
    return Figures{std::max(left, right)};
  });
}

absl::StatusOr<Finding> Gap(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float) {
    if (std::abs(x - kMiddle) < 3) return Sky(0);
    Surface s = Lit(x < kMiddle ? 0.8f : 0.2f);
    s.object = x < kMiddle ? 1 : 2;
    return s;
  });
  return Judge(trial, drawn, [](const Views& v) {
    const double left = Bleed(v, 0.6f, [](int x, int) { return x >= 53 && x < 61; });
    const double right = Bleed(v, 0.6f, [](int x, int) { return x >= 67 && x < 75; });
    return Figures{std::max(left, right)};
  });
}

/// Bias and variance of films that differ only in their seeds, in displayed values.
struct SeedErrors {
  metrics::SeedError filtered, noisy;
};

absl::StatusOr<metrics::SeedError> MeasureWithin(const std::vector<Picture>& pictures, const Picture& truth,
                                                 const Rect& crop) {
  const auto within = [&](const Picture& picture) {
    return ConstColorView{picture[0].view().Crop(crop), picture[1].view().Crop(crop),
                          picture[2].view().Crop(crop)};
  };
  std::vector<ConstColorView> views;
  views.reserve(pictures.size());
  for (const Picture& picture : pictures) views.push_back(within(picture));
  return metrics::MeasureSeeds(views, within(truth));
}

/// Filters films of `runs` seeds and measures them inside `crop`.
absl::StatusOr<Finding> JudgeSeeds(const Trial& trial, const Drawing& drawing, uint32_t samples, int runs,
                                   const Rect& crop, absl::FunctionRef<Figures(const SeedErrors&)> figures) {
  std::vector<Picture> filtered, noisy;
  Finding finding;
  for (int run = 1; run <= runs; ++run) {
    const DrawnFilm drawn = Draw(drawing, {.samples = samples, .seed = static_cast<uint32_t>(run)});
    absl::StatusOr<Finding> one = Judge(trial, drawn, [](const Views&) { return Figures(); });
    if (!one.ok()) return one.status();
    filtered.push_back(ClonePicture(ViewOf(one->exhibit.filtered)));
    noisy.push_back(ClonePicture(ViewOf(one->exhibit.noisy)));
    finding = *std::move(one);
  }
  const auto of_filtered = MeasureWithin(filtered, finding.exhibit.truth, crop);
  if (!of_filtered.ok()) return of_filtered.status();
  const auto of_noisy = MeasureWithin(noisy, finding.exhibit.truth, crop);
  if (!of_noisy.ok()) return of_noisy.status();
  finding.figures = figures({*of_filtered, *of_noisy});
  return finding;
}

constexpr float kRadius = 50;

absl::StatusOr<Finding> Sphere(const Trial& trial) {
  const auto drawing = [](float x, float y) {
    const float u = (x - kMiddle) / kRadius;
    const float v = (kMiddle - y) / kRadius;
    const float square = u * u + v * v;
    if (square > 1) return Sky(0.3f);
    const float z = std::sqrt(1 - square);
    Surface s = Lit(0.1f + 0.7f * std::max(0.0f, 0.48f * u + 0.64f * v + 0.6f * z), 5 - z);
    s.normal = {u, v, z};
    return s;
  };
  const Rect inside = {50, 34, 94, 78};  // all of it lit
  return JudgeSeeds(trial, drawing, 64, 8, inside, [](const SeedErrors& errors) {
    return Figures{std::sqrt(std::max(0.0, errors.filtered.bias_squared))};
  });
}

absl::StatusOr<Finding> NormalMap(const Trial& trial) {
  const auto drawing = [](float x, float y) {
    const bool up = (static_cast<int>(x / 2) + static_cast<int>(y / 2)) % 2 == 0;
    const float tilt = up ? 0.3f : -0.3f;
    const float z = std::sqrt(1 - tilt * tilt);
    Surface s = Lit(0.7f * (0.6f * tilt + 0.8f * z));
    s.normal = {tilt, 0, z};
    return s;
  };
  return JudgeSeeds(trial, drawing, 16, 4, {0, 0, kSize, kSize}, [](const SeedErrors& errors) {
    return Figures{errors.filtered.variance / errors.noisy.variance,
                   std::max(0.0, errors.filtered.bias_squared) / errors.noisy.variance};
  });
}

/// Strips of a lit and a shaded surface side by side, in bands of different albedos and lights. Their edges
/// divide columns of pixels by a quarter, a half and three quarters.
constexpr int kStrip = 16;
constexpr int kStrips = 16;
constexpr int kBand = 64;
struct Contrast {
  Triple lit_albedo;
  float lit;
  Triple shaded_albedo;
  float shaded;
};
constexpr Contrast kContrasts[] = {{Gray(0.9f), 0.8f, Gray(0.09f), 0.08f},
                                   {{0.8f, 0.6f, 0.4f}, 0.9f, {0.3f, 0.4f, 0.5f}, 0.5f},
                                   {Gray(0.2f), 1.0f, Gray(0.9f), 0.1f}};
constexpr int kCoverages = 3;

/// The left edge of a strip.
float StripBegin(int strip) {
  return static_cast<float>(kStrip * strip) + 0.25f * static_cast<float>(1 + strip % kCoverages);
}

bool IsLitStrip(int strip) { return strip % 2 == 0; }

/// Quarters of the column of pixels at the left edge of a strip that are lit, less one.
int LitCoverage(int strip) {
  return IsLitStrip(strip) ? kCoverages - 1 - strip % kCoverages : strip % kCoverages;
}

Surface StripAt(float x, float y) {
  const int pixel = static_cast<int>(x) / kStrip;
  const int strip = x < StripBegin(pixel) ? pixel - 1 : pixel;
  const Contrast& contrast = kContrasts[static_cast<int>(y) / kBand];
  const bool is_lit = IsLitStrip(strip);
  Surface s = Lit(is_lit ? contrast.lit : contrast.shaded, is_lit ? 2.0f : 3.0f);
  s.object = is_lit ? 1 : 2;
  s.normal = is_lit ? Triple{1, 0, 0} : Triple{0, 1, 0};
  s.albedo = is_lit ? contrast.lit_albedo : contrast.shaded_albedo;
  return s;
}

absl::StatusOr<Finding> MixedEdge(const Trial& trial) {
  constexpr uint32_t kSeeds = 8;
  constexpr int kBands = static_cast<int>(std::size(kContrasts));
  const auto is_mixed = [](int x, int y) {
    constexpr int kBorder = 4;  // px between bands that are left out
    const int row = y % kBand;
    return x > 0 && x % kStrip == 0 && row >= kBorder && row < kBand - kBorder;
  };
  constexpr int kGroups = kBands * kCoverages;
  std::array<double, kGroups> shifts = {};
  double error = 0;
  absl::StatusOr<Finding> finding;
  for (uint32_t seed = 1; seed <= kSeeds; ++seed) {
    const DrawnFilm drawn = DrawFilm(kStrip * kStrips, kBand * kBands, StripAt, {.seed = seed});
    finding = Judge(trial, drawn, [&](const Views& v) {
      for (int i = 0; i < kGroups; ++i) {
        const auto alike = [&](int x, int y) {
          return is_mixed(x, y) && y / kBand == i / kCoverages && LitCoverage(x / kStrip) == i % kCoverages;
        };
        shifts[static_cast<size_t>(i)] += (MeanOf(v.filtered, alike) - MeanOf(v.truth, alike)) / kSeeds;
      }
      error += ErrorLeft(v, is_mixed) / kSeeds;
      return Figures();
    });
    if (!finding.ok()) return finding;
  }
  double largest = 0;
  for (size_t i = 0; i < shifts.size(); ++i) {
    const Contrast& contrast = kContrasts[i / kCoverages];
    const double lit = static_cast<double>(contrast.lit * contrast.lit_albedo[1]);
    largest = std::max(largest, std::abs(shifts[i]) / lit);
  }
  finding->figures = {largest, error};
  return finding;
}

absl::StatusOr<Finding> Silhouette(const Trial& trial) {
  const auto is_sky = [](float x, float y) { return y < kMiddle + 20 * std::sin(x / 9); };
  const DrawnFilm drawn = Draw([&](float x, float y) { return is_sky(x, y) ? Sky(0.7f) : Lit(0.3f); });
  return Judge(trial, drawn, [&](const Views& v) {
    int touched = 0;
    ForEachPixel(kSize, kSize, [&](int x, int y) {
      const bool is_whole = drawn.film.pixels.Get("A").At(x, y) == 0;
      touched += is_whole && v.filtered[1].At(x, y) != v.noisy[1].At(x, y) ? 1 : 0;
    });
    return Figures{static_cast<double>(touched)};
  });
}

constexpr int kRods = 6;

/// The rod at a point, 1 to kRods from thin to thick, or 0.
int RodAt(float x, float y) {
  for (int rod = 1; rod <= kRods; ++rod) {
    const auto r = static_cast<float>(rod);
    const float slope = 0.25f * (r - 3.5f);
    const float across = (x - 18 * r - slope * (y - kMiddle)) / std::sqrt(1 + slope * slope);
    if (std::abs(across) < 0.25f * r) return rod;
  }
  return 0;
}

absl::StatusOr<Finding> Rods(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float y) {
    if (const int rod = RodAt(x, y); rod > 0) {
      Surface s = Lit(0.15f + 0.1f * static_cast<float>(rod), 2);
      s.object = 1 + rod;
      s.normal = {0.6f, 0, 0.8f};
      s.albedo = {0.8f, 0.5f, 0.3f};
      return s;
    }
    const bool is_dark = std::sin(x / 4) * std::sin(y / 5) > 0;
    Surface far = Lit(y < kMiddle ? 0.9f : 0.4f, 200);
    far.albedo = is_dark ? Triple{0.2f, 0.3f, 0.4f} : Triple{0.8f, 0.8f, 0.7f};
    return far;
  });
  return Judge(trial, drawn, [](const Views& v) {
    const auto on_rod = [](int x, int y) {
      return RodAt(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f) > 0;
    };
    return Figures{ErrorLeft(v, on_rod), ErrorLeft(v)};
  });
}

}  // namespace

std::vector<Case> GeometryCases() {
  return {
      {6,
       "pole",
       "a pole 2 px wide in front of a brighter wall: error on it",
       "128x128, 16 spp",
       "",
       {{"error", 0.1}},
       Pole},
      {7,
       "wires",
       "wires 1 px wide: RMS error on them over that of 16 noise-free sub-samples",
       "128x128, 64 spp",
       "",
       {{"over MSAA", 2}},
       Wires},
      {8,
       "grazing floor",
       "a floor up to the horizon: error in its far third",
       "128x128, 16 spp",
       "",
       {{"error", 0.1}},
       GrazingFloor},
      {9,
       "parallel planes",
       "two planes 1 % of their distance apart, light 2:1: shift of the mean of 8 px on either side, over "
       "the step",
       "128x128, 16 spp",
       "was 0.02: 1 % of depth is a fifth of its sigma, so only the light separates the planes, as at a "
       "shadow's border; 0.1 is less than a pixel",
       {{"bleed", 0.1}},
       ParallelPlanes},
      {10,
       "gap",
       "two boards in one plane, light 4:1, with 6 px of sky in between: shift of the mean of 8 px on either "
       "side, "
       "over the step",
       "128x128, 16 spp",
       "",
       {{"bleed", 0.05}},
       Gap},
      {11,
       "sphere",
       "a smooth sphere, 8 seeds: RMS bias of its lit side in 8-bit steps",
       "128x128, 64 spp",
       "was: bands below one of 255 steps; the RMS error common to all seeds measures them",
       {{"bias", 1}},
       Sphere},
      {12,
       "normal map",
       "normals that change by 35 degrees every 2 px, 4 seeds: variance and bias^2 over the noisy variance",
       "128x128, 16 spp",
       "",
       {{"variance", 0.3}, {"bias^2", 0.3}},
       NormalMap},
      {13,
       "mixed edge",
       "columns of pixels that two surfaces share 1:3, 1:1 and 3:1, of which one has a hundredth, a third or "
       "half of the other's light, 8 seeds: largest shift of the mean of such columns over the lit surface's "
       "light; error in their pixels",
       "256x192, 16 spp",
       "the first one for one contrast and 64 samples; the error of each pixel was added",
       {{"shift", 0.01}, {"error", 0.1}},
       MixedEdge},
      {14,
       "silhouette",
       "ground in front of sky: sky pixels whose bits differ from the input",
       "128x128, 16 spp",
       "",
       {{"touched", 0}},
       Silhouette},
      {37,
       "thin rods",
       "rods 0.5 to 3 px wide in front of a far, textured background: error on them, and of the whole "
       "picture",
       "128x128, 16 spp",
       "",
       {{"on rods", 0.3}, {"whole", 0.2}},
       Rods},
  };
}

}  // namespace lumifold::stability
