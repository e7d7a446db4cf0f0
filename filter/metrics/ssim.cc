#include "filter/metrics/ssim.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "filter/image/color.h"
#include "filter/image/planes.h"

namespace lumifold::metrics {
namespace {

constexpr int kRadius = 5;
constexpr int kWindow = 2 * kRadius + 1;
constexpr double kSigma = 1.5;
constexpr double kC1 = 0.01 * 0.01;
constexpr double kC2 = 0.03 * 0.03;
constexpr std::array<double, 5> kScalePowers = {0.0448, 0.2856, 0.3001, 0.2363, 0.1333};

/// One channel in double.
struct Channel {
  int width = 0;
  int height = 0;
  std::vector<double> values;

  Channel(int w, int h) : width(w), height(h), values(static_cast<size_t>(w) * static_cast<size_t>(h)) {}
  double& At(int x, int y) { return values[static_cast<size_t>(y) * width + x]; }
  double At(int x, int y) const { return values[static_cast<size_t>(y) * width + x]; }
};

Channel DisplayedLuminance(const ConstColorView& color, float exposure) {
  Channel out(color[0].width(), color[0].height());
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      const auto shown = [&](size_t c) { return SrgbFromLinear(exposure * color[c].At(x, y)); };
      out.At(x, y) = static_cast<double>(Luminance(shown(0), shown(1), shown(2)));
    }
  }
  return out;
}

std::array<double, kWindow> GaussianTaps() {
  std::array<double, kWindow> taps = {};
  double sum = 0;
  for (int i = 0; i < kWindow; ++i) {
    const double offset = (i - kRadius) / kSigma;
    sum += taps[static_cast<size_t>(i)] = std::exp(-0.5 * offset * offset);
  }
  for (double& tap : taps) tap /= sum;
  return taps;
}

/// Weighted means over the windows inside the picture; kWindow - 1 pixels smaller in both directions.
Channel WindowMeans(const Channel& in) {
  static const std::array<double, kWindow> taps = GaussianTaps();
  Channel rows(in.width - kWindow + 1, in.height);
  ForEachPixel(rows.width, rows.height, [&](int x, int y) {
    for (int i = 0; i < kWindow; ++i) rows.At(x, y) += taps[static_cast<size_t>(i)] * in.At(x + i, y);
  });
  Channel out(rows.width, in.height - kWindow + 1);
  for (int y = 0; y < out.height; ++y) {
    for (int i = 0; i < kWindow; ++i) {
      for (int x = 0; x < out.width; ++x) out.At(x, y) += taps[static_cast<size_t>(i)] * rows.At(x, y + i);
    }
  }
  return out;
}

Channel Product(const Channel& a, const Channel& b) {
  Channel out(a.width, a.height);
  for (size_t i = 0; i < out.values.size(); ++i) out.values[i] = a.values[i] * b.values[i];
  return out;
}

/// Means over all windows of the index and of its factor of contrast and structure.
struct Similarity {
  double whole = 0;
  double contrast_structure = 0;
};

Similarity Compare(const Channel& a, const Channel& b) {
  const Channel mean_a = WindowMeans(a);
  const Channel mean_b = WindowMeans(b);
  const Channel square_a = WindowMeans(Product(a, a));
  const Channel square_b = WindowMeans(Product(b, b));
  const Channel product = WindowMeans(Product(a, b));
  Similarity sum;
  for (size_t i = 0; i < product.values.size(); ++i) {
    const double ma = mean_a.values[i];
    const double mb = mean_b.values[i];
    const double variances = square_a.values[i] - ma * ma + square_b.values[i] - mb * mb;
    const double covariance = product.values[i] - ma * mb;
    const double contrast_structure = (2 * covariance + kC2) / (variances + kC2);
    sum.contrast_structure += contrast_structure;
    sum.whole += contrast_structure * (2 * ma * mb + kC1) / (ma * ma + mb * mb + kC1);
  }
  const auto count = static_cast<double>(product.values.size());
  return {sum.whole / count, sum.contrast_structure / count};
}

/// Means over 2x2 pixels; an odd last row or column is left out.
Channel Halve(const Channel& in) {
  Channel out(in.width / 2, in.height / 2);
  ForEachPixel(out.width, out.height, [&](int x, int y) {
    out.At(x, y) = 0.25 * (in.At(2 * x, 2 * y) + in.At(2 * x + 1, 2 * y) + in.At(2 * x, 2 * y + 1) +
                           in.At(2 * x + 1, 2 * y + 1));
  });
  return out;
}

absl::Status CheckSize(const ConstColorView& picture, const ConstColorView& reference, int least,
                       const char* metric) {
  const int width = reference[0].width();
  const int height = reference[0].height();
  LUMIFOLD_CHECK(picture[0].width() == width && picture[0].height() == height);
  if (std::min(width, height) >= least) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(metric, " needs ", least, "x", least, " pixels, not ", width, "x", height));
}

}  // namespace

absl::StatusOr<double> Ssim(const ConstColorView& picture, const ConstColorView& reference, float exposure) {
  if (absl::Status status = CheckSize(picture, reference, kWindow, "SSIM"); !status.ok()) return status;
  return Compare(DisplayedLuminance(picture, exposure), DisplayedLuminance(reference, exposure)).whole;
}

absl::StatusOr<double> MsSsim(const ConstColorView& picture, const ConstColorView& reference,
                              float exposure) {
  constexpr int kLeast = kWindow << (kScalePowers.size() - 1);
  if (absl::Status status = CheckSize(picture, reference, kLeast, "MS-SSIM"); !status.ok()) return status;
  Channel a = DisplayedLuminance(picture, exposure);
  Channel b = DisplayedLuminance(reference, exposure);
  double index = 1;
  for (size_t scale = 0; scale < kScalePowers.size(); ++scale) {
    const bool is_last = scale + 1 == kScalePowers.size();
    const Similarity similarity = Compare(a, b);
    const double factor = is_last ? similarity.whole : similarity.contrast_structure;
    index *= std::pow(std::max(0.0, factor), kScalePowers[scale]);
    if (is_last) break;
    a = Halve(a);
    b = Halve(b);
  }
  return index;
}

}  // namespace lumifold::metrics
