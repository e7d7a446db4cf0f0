#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/image/color.h"
#include "filter/image/planes.h"
#include "filter/metrics/flip.h"
#include "filter/metrics/mean.h"

namespace lumifold::metrics {
namespace {

/// The ACES tone curve (k0 x^2 + k1 x) / (k3 x^2 + k4 x + k5), with the published fit's exposure of 0.6
/// included in the constants.
struct Aces {
  static constexpr double k0 = 0.6 * 0.6 * 2.51;
  static constexpr double k1 = 0.6 * 0.03;
  static constexpr double k3 = 0.6 * 0.6 * 2.43;
  static constexpr double k4 = 0.6 * 0.59;
  static constexpr double k5 = 0.14;

  static float Show(double x) {
    if (!(x > 0)) return 0;
    const double nominator = k0 * x * x + k1 * x;
    const double shown = nominator / (k3 * x * x + k4 * x + k5);
    return std::isfinite(nominator) ? static_cast<float>(std::min(shown, 1.0)) : 1.0f;
  }

  /// The inverse: the light that the curve maps to `shown`, in (0, 1).
  static double LightOf(double shown) {
    const double a = k0 - shown * k3;
    const double b = k1 - shown * k4;
    const double c = -shown * k5;
    return (-b + std::sqrt(b * b - 4 * a * c)) / (2 * a);
  }
};

Picture Show(const ConstColorView& light, double exposure) {
  Picture shown;
  for (size_t c = 0; c < 3; ++c) {
    shown[c] = Plane(light[c].width(), light[c].height());
    ForEachPixel(light[c].width(), light[c].height(), [&](int x, int y) {
      shown[c].At(x, y) = Aces::Show(exposure * static_cast<double>(light[c].At(x, y)));
    });
  }
  return shown;
}

/// The positive luminances, unordered.
std::vector<float> LuminancesOf(const ConstColorView& light) {
  std::vector<float> values;
  ForEachPixel(light[0].width(), light[0].height(), [&](int x, int y) {
    const float value = LuminanceAt(light, x, y);
    if (value > 0 && std::isfinite(value)) values.push_back(value);
  });
  return values;
}

/// The exposures, as factors on the light.
std::vector<double> Exposures(const ConstColorView& reference) {
  constexpr double kShown = 0.85;
  std::vector<float> luminances = LuminancesOf(reference);
  if (luminances.empty()) return {1.0};
  const auto middle = luminances.begin() + static_cast<std::ptrdiff_t>((luminances.size() - 1) / 2);
  std::nth_element(luminances.begin(), middle, luminances.end());
  const auto median = static_cast<double>(*middle);
  const auto brightest = static_cast<double>(*std::max_element(luminances.begin(), luminances.end()));
  const double start = std::log2(Aces::LightOf(kShown) / brightest);
  const double stop = std::log2(Aces::LightOf(kShown) / median);
  const int count = std::max(2, static_cast<int>(std::ceil(stop - start)));
  std::vector<double> exposures;
  exposures.reserve(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i) exposures.push_back(std::exp2(start + (stop - start) * i / (count - 1)));
  return exposures;
}

}  // namespace

Plane HdrFlipMap(const ConstColorView& picture, const ConstColorView& reference) {
  Plane worst(reference[0].width(), reference[0].height());
  for (const double exposure : Exposures(reference)) {
    const Picture a = Show(picture, exposure);
    const Picture b = Show(reference, exposure);
    const Plane map = FlipMap(ViewOf(a), ViewOf(b));
    ForEachPixel(worst.width(), worst.height(),
                 [&](int x, int y) { worst.At(x, y) = std::max(worst.At(x, y), map.At(x, y)); });
  }
  return worst;
}

double HdrFlip(const ConstColorView& picture, const ConstColorView& reference) {
  return MeanOf(HdrFlipMap(picture, reference).view());
}

}  // namespace lumifold::metrics
