// Light that is hard to filter: edges without geometry, sources much brighter than the surfaces they light.
#include <algorithm>
#include <cmath>
#include <utility>

#include "tests/charts/metrics/blotch.h"
#include "tests/stability/case.h"

namespace lumifold::stability {
namespace {

using Figures = std::vector<double>;

constexpr int kSize = 128;
constexpr float kMiddle = kSize / 2.0f;

Surface Lit(const Triple& direct, const Triple& indirect = Gray(0)) {
  Surface s;
  s.direct = direct;
  s.indirect = indirect;
  return s;
}

DrawnFilm Draw(const Drawing& drawing, const Sampling& sampling = {}) {
  return DrawFilm(kSize, kSize, drawing, sampling);
}

/// Signed distance of the centre of pixel (x, y) from a slightly tilted line, positive to its right.
float BesideLine(float x, float y) { return (x - kMiddle + 0.3f * (y - kMiddle)) / std::sqrt(1.09f); }
float PixelBesideLine(int x, int y) {
  return BesideLine(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
}

absl::StatusOr<Finding> ConstantLight(const Trial& trial) {
  const DrawnFilm drawn = DrawFilm(256, 256, [](float, float) { return Lit(Gray(0.5f)); }, {});
  absl::StatusOr<metrics::Blotch> blotch;
  absl::StatusOr<Finding> finding = Judge(trial, drawn, [&](const Views& v) {
    blotch = metrics::MeasureBlotch(v.filtered, v.noisy, v.truth);
    return Figures{ErrorLeft(v)};
  });
  if (!finding.ok()) return finding;
  if (!blotch.ok()) return blotch.status();
  finding->figures.push_back(blotch->luminance);
  return finding;
}

absl::StatusOr<Finding> HardShadow(const Trial& trial) {
  const DrawnFilm drawn =
      Draw([](float x, float y) { return Lit(Gray(BesideLine(x, y) < 0 ? 0.05f : 0.8f)); });
  return Judge(trial, drawn, [](const Views& v) {
    const auto near = [](int x, int y) { return std::abs(PixelBesideLine(x, y)) < 4; };
    constexpr float kReach = 16;
    const double wider =
        EdgeWidth(v.filtered[1], kReach, PixelBesideLine) - EdgeWidth(v.truth[1], kReach, PixelBesideLine);
    return Figures{ErrorLeft(v, near), wider};
  });
}

/// The largest difference of the means of adjacent columns on the ramp, over that of the truth.
double LargestStep(const ConstFloatView& picture, const ConstFloatView& truth, int x0, int x1) {
  const auto mean = [](const ConstFloatView& plane, int x) {
    double sum = 0;
    for (int y = 0; y < plane.height(); ++y) sum += static_cast<double>(plane.At(x, y));
    return sum;
  };
  double largest = 0;
  for (int x = x0; x + 1 < x1; ++x) {
    const double expected = mean(truth, x + 1) - mean(truth, x);
    largest = std::max(largest, (mean(picture, x + 1) - mean(picture, x)) / expected);
  }
  return largest;
}

absl::StatusOr<Finding> Penumbra(const Trial& trial) {
  const DrawnFilm drawn =
      Draw([](float x, float) { return Lit(Gray(0.05f + 0.75f * std::clamp((x - 24) / 80, 0.0f, 1.0f))); });
  return Judge(trial, drawn, [](const Views& v) {
    return Figures{ErrorLeft(v), LargestStep(v.filtered[1], v.truth[1], 26, 102)};
  });
}

constexpr float kLampRadius = 10;

float FromMiddle(int x, int y) {
  return std::hypot(static_cast<float>(x) + 0.5f - kMiddle, static_cast<float>(y) + 0.5f - kMiddle);
}

absl::StatusOr<Finding> LampOnWall(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float y) {
    Surface s = Lit(Gray(0.5f));
    if (std::hypot(x - kMiddle, y - kMiddle) > kLampRadius) return s;
    s.object = 2;
    s.has_diffuse = false;
    s.emission = Gray(1000);
    return s;
  });
  return Judge(trial, drawn, [](const Views& v) {
    const auto ring = [](int x, int y) {
      return FromMiddle(x, y) > kLampRadius + 1 && FromMiddle(x, y) < kLampRadius + 9;
    };
    return Figures{std::abs(DisplayShift(v.filtered, v.truth, ring)), ErrorLeft(v, ring)};
  });
}

float BesideCaustic(float x, float y) { return y - kMiddle - 20 * std::sin(x / 20); }

absl::StatusOr<Finding> Caustic(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float y) {
    const float d = BesideCaustic(x, y);
    return Lit(Gray(0.2f), Gray(0.05f + 0.6f * std::exp(-d * d / 4.5f)));
  });
  return Judge(trial, drawn, [](const Views& v) {
    const auto crest = [](int x, int y) {
      return std::abs(BesideCaustic(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f)) < 0.5f;
    };
    return Figures{100 * MeanOf(v.filtered, crest) / MeanOf(v.truth, crest), ErrorLeft(v)};
  });
}

absl::StatusOr<Finding> Projector(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float y) {
    const float waves = 0.5f + 0.2f * std::sin(x / 3) + 0.2f * std::sin((x + 2 * y) / 5);
    const bool is_bright = (static_cast<int>(x / 8) + static_cast<int>(y / 8)) % 2 == 0;
    const float light = is_bright ? waves : 0.3f * waves;
    return Lit({light, 0.8f * light, 0.6f * light});
  });
  return Judge(trial, drawn, [](const Views& v) { return Figures{ErrorLeft(v)}; });
}

absl::StatusOr<Finding> ColoredLight(const Trial& trial) {
  const DrawnFilm drawn =
      Draw([](float x, float y) { return BesideLine(x, y) < 0 ? Lit({0.6f, 0, 0}) : Lit({0, 0, 0.6f}); });
  return Judge(trial, drawn, [](const Views& v) {
    const auto left = [](int x, int y) { return PixelBesideLine(x, y) < -1; };
    const auto right = [](int x, int y) { return PixelBesideLine(x, y) > 1; };
    const double shift = std::max(DeltaE(v.filtered, v.truth, left), DeltaE(v.filtered, v.truth, right));
    return Figures{shift, static_cast<double>(CountNotFinite(v.filtered))};
  });
}

absl::StatusOr<Finding> UnlikeLights(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float y) {
    return Lit(Gray(std::hypot(x - kMiddle, y - kMiddle) < kLampRadius ? 500.0f : 0.05f));
  });
  return Judge(trial, drawn, [](const Views& v) {
    const auto dark = [](int x, int y) { return FromMiddle(x, y) > kLampRadius + 1; };
    return Figures{ErrorLeft(v, dark), std::abs(DisplayShift(v.filtered, v.truth, dark))};
  });
}

absl::StatusOr<Finding> ThinWall(const Trial& trial) {
  const DrawnFilm drawn = Draw([](float x, float y) {
    const float d = BesideLine(x, y);
    Surface s = Lit(Gray(d < 0 ? 0.9f : 0.004f));
    s.normal = {0, 1, 0};
    if (std::abs(d) > 1) return s;
    s.object = 2;
    s.normal = {0, 0, 1};
    s.direct = Gray(0.3f);
    return s;
  });
  return Judge(trial, drawn, [](const Views& v) {
    const auto behind = [](int x, int y) { return PixelBesideLine(x, y) > 2 && PixelBesideLine(x, y) < 14; };
    return Figures{std::abs(DisplayShift(v.filtered, v.truth, behind)), ErrorLeft(v, behind)};
  });
}

}  // namespace

std::vector<Case> LightCases() {
  return {
      {1,
       "constant light",
       "one lit plane with noise: error; blotch index",
       "256x256, 16 spp",
       "",
       {{"error", 0.02}, {"blotch", 1.05}},
       ConstantLight},
      {4,
       "hard shadow",
       "a shadow edge on one plane, 16:1: error within 4 px; 10-90 % width minus that of the truth, px",
       "128x128, 16 spp",
       "",
       {{"error", 0.3}, {"wider", 1}},
       HardShadow},
      {5,
       "penumbra",
       "a ramp over 80 px: error; largest step between columns over the true one",
       "128x128, 16 spp",
       "",
       {{"error", 0.05}, {"step", 2}},
       Penumbra},
      {15,
       "lamp on a wall",
       "an emitter of 1000 on a wall of 0.5: shift of the 8 px around it in 8-bit steps; error there",
       "128x128, 16 spp",
       "",
       {{"shift", 1}, {"error", 0.1}},
       LampOnWall},
      {17,
       "caustic",
       "a curve of light 3 px wide: peak preserved in %; error",
       "128x128, 16 spp",
       "",
       {{"crest", 80, true}, {"error", 0.3}},
       Caustic},
      {18,
       "projector",
       "light projected from a picture onto one plane: error",
       "128x128, 16 spp",
       "",
       {{"error", 0.5}},
       Projector},
      {29,
       "coloured light",
       "red light next to blue light: colour shift on either side (CIE 1976); pixels not finite",
       "128x128, 16 spp",
       "",
       {{"shift", 1}, {"bad", 0}},
       ColoredLight},
      {35,
       "lights of 10,000:1",
       "a spot of 500 on a plane of 0.05: error in the dark part; its shift in 8-bit steps",
       "128x128, 16 spp",
       "",
       {{"error", 0.1}, {"shift", 1}},
       UnlikeLights},
      {36,
       "light leak",
       "a dark floor behind a wall of 2 px, a bright one in front: shift of the first 12 px in 8-bit steps; "
       "error there",
       "128x128, 16 spp",
       "",
       {{"shift", 1}, {"error", 0.1}},
       ThinWall},
  };
}

}  // namespace lumifold::stability
