#include "tests/stability/errors.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "filter/image/color.h"
#include "filter/image/planes.h"

namespace lumifold::stability {
namespace {

double Display(float linear) { return 255 * static_cast<double>(SrgbFromLinear(linear)); }

/// Mean of `value(c, x, y)` over channels and selected pixels.
double MeanOver(const ConstColorView& picture, Where where,
                absl::FunctionRef<double(size_t, int, int)> value) {
  double sum = 0;
  int64_t count = 0;
  ForEachPixel(picture[0].width(), picture[0].height(), [&](int x, int y) {
    if (!where(x, y)) return;
    for (size_t c = 0; c < 3; ++c) sum += value(c, x, y);
    count += 3;
  });
  return count > 0 ? sum / static_cast<double>(count) : 0;
}

double Square(double x) { return x * x; }

Triple MeanColor(const ConstColorView& picture, Where where) {
  std::array<double, 3> sum = {};
  int64_t count = 0;
  ForEachPixel(picture[0].width(), picture[0].height(), [&](int x, int y) {
    if (!where(x, y)) return;
    for (size_t c = 0; c < 3; ++c) sum[c] += static_cast<double>(picture[c].At(x, y));
    ++count;
  });
  Triple mean = {};
  for (size_t c = 0; c < 3; ++c)
    mean[c] = static_cast<float>(sum[c] / static_cast<double>(std::max<int64_t>(count, 1)));
  return mean;
}

std::array<double, 3> LabOf(const Triple& rgb) {
  // The matrix from sRGB to XYZ, its rows divided by the D65 white point.
  constexpr double kRows[3][3] = {
      {0.4339, 0.3762, 0.1899}, {0.2126, 0.7152, 0.0722}, {0.0177, 0.1095, 0.8728}};
  double f[3];
  for (int i = 0; i < 3; ++i) {
    double t = 0;
    for (size_t c = 0; c < 3; ++c) t += kRows[i][c] * static_cast<double>(rgb[c]);
    f[i] = t > 0.008856 ? std::cbrt(t) : 7.787 * t + 16.0 / 116;
  }
  return {116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])};
}

/// The position at which the profile, rising from its first value to its last, crosses the fraction `level`.
double Crossing(const std::vector<double>& profile, double level) {
  const double low = profile.front();
  const double span = profile.back() - low;
  for (size_t i = 1; i < profile.size(); ++i) {
    const double before = (profile[i - 1] - low) / span;
    const double here = (profile[i] - low) / span;
    if (here >= level) return static_cast<double>(i) - (here > before ? (here - level) / (here - before) : 0);
  }
  return static_cast<double>(profile.size() - 1);
}

}  // namespace

double DisplayError(const ConstColorView& a, const ConstColorView& b, Where where) {
  return MeanOver(a, where, [&](size_t c, int x, int y) {
    return Square(Display(a[c].At(x, y)) - Display(b[c].At(x, y)));
  });
}

double LinearError(const ConstColorView& a, const ConstColorView& b, Where where) {
  return MeanOver(a, where, [&](size_t c, int x, int y) {
    return Square(static_cast<double>(a[c].At(x, y)) - static_cast<double>(b[c].At(x, y)));
  });
}

double MeanOf(const ConstColorView& picture, Where where) {
  return MeanOver(picture, where,
                  [&](size_t c, int x, int y) { return static_cast<double>(picture[c].At(x, y)); });
}

double DisplayShift(const ConstColorView& a, const ConstColorView& b, Where where) {
  return MeanOver(a, where,
                  [&](size_t c, int x, int y) { return Display(a[c].At(x, y)) - Display(b[c].At(x, y)); });
}

int CountNotFinite(const ConstColorView& picture) {
  int count = 0;
  for (int y = 0; y < picture[0].height(); ++y) {
    for (int x = 0; x < picture[0].width(); ++x) {
      const auto bad = [&](const ConstFloatView& plane) { return !std::isfinite(plane.At(x, y)); };
      count += std::any_of(picture.begin(), picture.end(), bad) ? 1 : 0;
    }
  }
  return count;
}

int CountDifferent(const ConstColorView& a, const ConstColorView& b) {
  int count = 0;
  ForEachPixel(a[0].width(), a[0].height(), [&](int x, int y) {
    bool same = true;
    for (size_t c = 0; c < 3; ++c)
      same &= std::bit_cast<uint32_t>(a[c].At(x, y)) == std::bit_cast<uint32_t>(b[c].At(x, y));
    count += same ? 0 : 1;
  });
  return count;
}

double LonePixels(const ConstColorView& picture, const ConstColorView& truth) {
  constexpr float kVisible = 24.0f / 255;
  const auto shown = [](const ConstColorView& color, int x, int y) {
    return Luminance(SrgbFromLinear(color[0].At(x, y)), SrgbFromLinear(color[1].At(x, y)),
                     SrgbFromLinear(color[2].At(x, y)));
  };
  const int width = picture[0].width(), height = picture[0].height();
  int lone = 0;
  for (int y = 1; y + 1 < height; ++y) {
    for (int x = 1; x + 1 < width; ++x) {
      float low = 1, high = 0;
      for (int i = 0; i < 9; ++i) {
        if (i == 4) continue;
        const float beside = shown(picture, x + i % 3 - 1, y + i / 3 - 1);
        low = std::min(low, beside), high = std::max(high, beside);
      }
      const float here = shown(picture, x, y), true_here = shown(truth, x, y);
      const bool is_bright = here > high + kVisible && true_here < high + kVisible / 2;
      const bool is_dark = here < low - kVisible && true_here > low - kVisible / 2;
      lone += is_bright || is_dark ? 1 : 0;
    }
  }
  return 10000.0 * lone / (static_cast<double>(width) * height);
}

double LargestRelativeDifference(const ConstColorView& a, const ConstColorView& b, Where where) {
  const double mean = MeanOver(
      b, where, [&](size_t c, int x, int y) { return std::abs(static_cast<double>(b[c].At(x, y))); });
  double largest = 0;
  ForEachPixel(a[0].width(), a[0].height(), [&](int x, int y) {
    if (!where(x, y)) return;
    for (size_t c = 0; c < 3; ++c) {
      const double expected = static_cast<double>(b[c].At(x, y));
      const double off = std::abs(static_cast<double>(a[c].At(x, y)) - expected);
      largest = std::max(largest, off / std::max(std::max(std::abs(expected), mean), 1e-30));
    }
  });
  return largest;
}

double DeltaE(const ConstColorView& a, const ConstColorView& b, Where where) {
  const std::array<double, 3> lab_a = LabOf(MeanColor(a, where));
  const std::array<double, 3> lab_b = LabOf(MeanColor(b, where));
  double sum = 0;
  for (size_t i = 0; i < 3; ++i) sum += Square(lab_a[i] - lab_b[i]);
  return std::sqrt(sum);
}

double EdgeWidth(ConstFloatView plane, float reach, absl::FunctionRef<float(int, int)> distance) {
  constexpr int kBinsPerPixel = 2;
  const auto bins = static_cast<size_t>(2 * reach * kBinsPerPixel);
  std::vector<double> sums(bins, 0);
  std::vector<int> counts(bins, 0);
  ForEachPixel(plane.width(), plane.height(), [&](int x, int y) {
    const float at = (distance(x, y) + reach) * kBinsPerPixel;
    if (!(at >= 0) || at >= static_cast<float>(bins)) return;
    sums[static_cast<size_t>(at)] += static_cast<double>(plane.At(x, y));
    ++counts[static_cast<size_t>(at)];
  });
  std::vector<double> profile;
  for (size_t i = 0; i < bins; ++i) {
    if (counts[i] > 0) profile.push_back(sums[i] / counts[i]);
  }
  return (Crossing(profile, 0.9) - Crossing(profile, 0.1)) / kBinsPerPixel;
}

}  // namespace lumifold::stability
