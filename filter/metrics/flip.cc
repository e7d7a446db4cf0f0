#include "filter/metrics/flip.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "filter/image/check.h"
#include "filter/image/planes.h"
#include "filter/metrics/mean.h"

namespace lumifold::metrics {
namespace {

using Color = std::array<float, 3>;

constexpr double kPixelsPerDegree = 67.0;
constexpr float kColorPower = 0.7f;
constexpr float kKneeShare = 0.4f;   // of the greatest colour difference: differences up to here ...
constexpr float kKneeValue = 0.95f;  // ... map to [0, this]
constexpr double kFeatureDegrees = 0.082;

// The white point of D65, and linear sRGB in it.
constexpr Color kWhite = {0.950428545f, 1.0f, 1.088900371f};

Color XyzFromRgb(const Color& c) {
  return {(10135552.0f * c[0] + 8788810.0f * c[1] + 4435075.0f * c[2]) / 24577794.0f,
          (2613072.0f * c[0] + 8788810.0f * c[1] + 887015.0f * c[2]) / 12288897.0f,
          (1425312.0f * c[0] + 8788810.0f * c[1] + 70074185.0f * c[2]) / 73733382.0f};
}

/// XYZ over the white point's.
Color RelativeXyz(const Color& rgb) {
  const Color xyz = XyzFromRgb(rgb);
  return {xyz[0] / kWhite[0], xyz[1] / kWhite[1], xyz[2] / kWhite[2]};
}

/// Opponent colours, linear in light: achromatic, red-green, blue-yellow.
Color YcxczFromRgb(const Color& rgb) {
  const Color xyz = RelativeXyz(rgb);
  return {116.0f * xyz[1] - 16.0f, 500.0f * (xyz[0] - xyz[1]), 200.0f * (xyz[1] - xyz[2])};
}

/// The inverse, clamped to the colours a display can show.
Color ShownRgbFromYcxcz(const Color& ycc) {
  const float relative_y = (ycc[0] + 16.0f) / 116.0f;
  const float x = (relative_y + ycc[1] / 500.0f) * kWhite[0];
  const float y = relative_y * kWhite[1];
  const float z = (relative_y - ycc[2] / 200.0f) * kWhite[2];
  const Color rgb = {3.241003275f * x - 1.537398934f * y - 0.498615861f * z,
                     -0.969224334f * x + 1.875930071f * y + 0.041554224f * z,
                     0.055639423f * x - 0.204011202f * y + 1.057148933f * z};
  return {std::clamp(rgb[0], 0.0f, 1.0f), std::clamp(rgb[1], 0.0f, 1.0f), std::clamp(rgb[2], 0.0f, 1.0f)};
}

/// L*a*b* with its chroma scaled by lightness: the chroma of dark colours is perceived less (Hunt effect).
Color HuntLabFromRgb(const Color& rgb) {
  constexpr float kDelta = 6.0f / 29.0f;
  const auto root = [](float t) {
    return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3.0f * kDelta * kDelta) + 4.0f / 29.0f;
  };
  const Color xyz = RelativeXyz(rgb);
  const float lightness = 116.0f * root(xyz[1]) - 16.0f;
  const float hunt = 0.01f * lightness;
  return {lightness, hunt * 500.0f * (root(xyz[0]) - root(xyz[1])),
          hunt * 200.0f * (root(xyz[1]) - root(xyz[2]))};
}

/// The HyAB distance, for large colour differences: city block between lightness and chroma.
float HyAb(const Color& a, const Color& b) {
  return std::abs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]);
}

/// Taps of an odd count; separable filters are a pair of them.
using Taps = std::vector<float>;

/// Filters rows by `across` and columns by `down`, of one length.
Plane Convolve(ConstFloatView in, const Taps& across, const Taps& down) {
  const int taps = static_cast<int>(across.size());
  const int radius = taps / 2;
  Plane rows(in.width(), in.height());
  for (int y = 0; y < in.height(); ++y) {
    const float* row = in.Row(y);
    for (int x = 0; x < in.width(); ++x) {
      float sum = 0;
      for (int i = 0; i < taps; ++i)
        sum += across[static_cast<size_t>(i)] * row[std::clamp(x + i - radius, 0, in.width() - 1)];
      rows.At(x, y) = sum;
    }
  }
  Plane out(in.width(), in.height());
  for (int y = 0; y < in.height(); ++y) {
    float* sums = out.Row(y);
    for (int i = 0; i < taps; ++i) {
      const float tap = down[static_cast<size_t>(i)];
      const float* row = rows.Row(std::clamp(y + i - radius, 0, in.height() - 1));
      for (int x = 0; x < in.width(); ++x) sums[x] += tap * row[x];
    }
  }
  return out;
}

/// The contrast sensitivity function in the spatial domain: a Gaussian a sqrt(pi / b) exp(-pi^2 x^2 / b).
struct Sensitivity {
  double a;
  double b;
};

/// Of the achromatic and red-green opponent colours; blue-yellow is a sum of two.
constexpr Sensitivity kAchromatic = {1, 0.0047};
constexpr Sensitivity kRedGreen = {1, 0.0053};
constexpr Sensitivity kBlueYellow = {34.1, 0.04};
constexpr Sensitivity kBlueYellow2 = {13.5, 0.025};

int SensitivityRadius() {
  const double widest = std::sqrt(kBlueYellow.b / (2 * std::numbers::pi * std::numbers::pi));
  return static_cast<int>(std::ceil(3 * widest * kPixelsPerDegree));
}

/// The Gaussian's taps, which sum to 1, and its weight in a sum of Gaussians over the pixel grid.
struct Gaussian {
  Taps taps;
  double weight = 0;
};

Gaussian GaussianOf(const Sensitivity& s) {
  const int radius = SensitivityRadius();
  std::vector<double> values;
  double sum = 0;
  for (int i = -radius; i <= radius; ++i) {
    const double degrees = i / kPixelsPerDegree;
    sum += values.emplace_back(std::exp(-std::numbers::pi * std::numbers::pi * degrees * degrees / s.b));
  }
  Gaussian gaussian;
  for (const double value : values) gaussian.taps.push_back(static_cast<float>(value / sum));
  gaussian.weight = s.a * std::sqrt(std::numbers::pi / s.b) * sum * sum;
  return gaussian;
}

Plane FilterBlueYellow(ConstFloatView in) {
  const Gaussian first = GaussianOf(kBlueYellow);
  const Gaussian second = GaussianOf(kBlueYellow2);
  Plane out = Convolve(in, first.taps, first.taps);
  const Plane other = Convolve(in, second.taps, second.taps);
  const auto share = static_cast<float>(first.weight / (first.weight + second.weight));
  ForEachPixel(out.width(), out.height(),
               [&](int x, int y) { out.At(x, y) = share * out.At(x, y) + (1.0f - share) * other.At(x, y); });
  return out;
}

template <typename Function>
Picture MapColors(const Picture& in, Function function) {
  Picture out;
  for (Plane& plane : out) plane = Plane(in[0].width(), in[0].height());
  ForEachPixel(in[0].width(), in[0].height(), [&](int x, int y) {
    const Color color = function(Color{in[0].At(x, y), in[1].At(x, y), in[2].At(x, y)});
    for (size_t c = 0; c < 3; ++c) out[c].At(x, y) = color[c];
  });
  return out;
}

/// The picture in Hunt-adjusted L*a*b*, without the detail that the eye cannot resolve.
Picture Perceived(const Picture& opponent) {
  const Taps achromatic = GaussianOf(kAchromatic).taps;
  const Taps red_green = GaussianOf(kRedGreen).taps;
  Picture seen;
  seen[0] = Convolve(opponent[0].view(), achromatic, achromatic);
  seen[1] = Convolve(opponent[1].view(), red_green, red_green);
  seen[2] = FilterBlueYellow(opponent[2].view());
  return MapColors(seen, [](const Color& ycc) { return HuntLabFromRgb(ShownRgbFromYcxcz(ycc)); });
}

/// The colour difference, remapped to [0, 1].
float ColorDifference(const Color& a, const Color& b) {
  static const float greatest =
      std::pow(HyAb(HuntLabFromRgb({0, 1, 0}), HuntLabFromRgb({0, 0, 1})), kColorPower);
  const float difference = std::pow(HyAb(a, b), kColorPower);
  const float knee = kKneeShare * greatest;
  if (difference < knee) return kKneeValue / knee * difference;
  return kKneeValue + (difference - knee) / (greatest - knee) * (1.0f - kKneeValue);
}

/// A Gaussian and its first and second derivatives; positive and negative parts are scaled to a sum of 1
/// each.
struct FeatureTaps {
  Taps smooth;
  Taps edge;
  Taps point;
};

FeatureTaps MakeFeatureTaps() {
  const double sigma = 0.5 * kFeatureDegrees * kPixelsPerDegree;
  const int radius = static_cast<int>(std::ceil(3 * sigma));
  const auto scaled = [radius](auto value) {
    double positive = 0, negative = 0;
    for (int i = -radius; i <= radius; ++i) (value(i) > 0 ? positive : negative) += value(i);
    Taps taps;
    for (int i = -radius; i <= radius; ++i)
      taps.push_back(static_cast<float>(value(i) > 0 ? value(i) / positive : -value(i) / negative));
    return taps;
  };
  const auto gauss = [sigma](int i) { return std::exp(-i * i / (2 * sigma * sigma)); };
  FeatureTaps taps;
  double sum = 0;
  for (int i = -radius; i <= radius; ++i) sum += gauss(i);
  for (int i = -radius; i <= radius; ++i) taps.smooth.push_back(static_cast<float>(gauss(i) / sum));
  taps.edge = scaled([&](int i) { return -i * gauss(i); });
  taps.point = scaled([&](int i) { return (i * i / (sigma * sigma) - 1) * gauss(i); });
  return taps;
}

/// The strength of one kind of feature in each pixel.
Plane Features(ConstFloatView grey, const Taps& kind, const Taps& smooth) {
  Plane across = Convolve(grey, kind, smooth);
  const Plane down = Convolve(grey, smooth, kind);
  ForEachPixel(across.width(), across.height(),
               [&](int x, int y) { across.At(x, y) = std::hypot(across.At(x, y), down.At(x, y)); });
  return across;
}

/// The difference of edge and point strength between the pictures, in [0, 1].
Plane FeatureDifferences(const Picture& opponent_a, const Picture& opponent_b) {
  static const FeatureTaps taps = MakeFeatureTaps();
  const auto grey = [](const Picture& opponent) {
    Plane plane = opponent[0].Clone();
    ForEachPixel(plane.width(), plane.height(),
                 [&](int x, int y) { plane.At(x, y) = (plane.At(x, y) + 16.0f) / 116.0f; });
    return plane;
  };
  const Plane a = grey(opponent_a);
  const Plane b = grey(opponent_b);
  Plane edges = Features(a.view(), taps.edge, taps.smooth);
  const Plane other_edges = Features(b.view(), taps.edge, taps.smooth);
  const Plane points = Features(a.view(), taps.point, taps.smooth);
  const Plane other_points = Features(b.view(), taps.point, taps.smooth);
  ForEachPixel(edges.width(), edges.height(), [&](int x, int y) {
    const float edge = std::abs(edges.At(x, y) - other_edges.At(x, y));
    const float point = std::abs(points.At(x, y) - other_points.At(x, y));
    edges.At(x, y) = std::sqrt(std::max(edge, point) / std::numbers::sqrt2_v<float>);
  });
  return edges;
}

/// Linear light, clamped to the display's range.
Picture Shown(const ConstColorView& color, float exposure) {
  Picture shown;
  for (size_t c = 0; c < 3; ++c) {
    shown[c] = Plane(color[c].width(), color[c].height());
    ForEachPixel(color[c].width(), color[c].height(), [&](int x, int y) {
      const float value = exposure * color[c].At(x, y);
      shown[c].At(x, y) = value > 0 ? std::min(value, 1.0f) : 0.0f;
    });
  }
  return shown;
}

}  // namespace

Plane FlipMap(const ConstColorView& picture, const ConstColorView& reference, float exposure) {
  LUMIFOLD_CHECK(reference[0].width() > 0 && reference[0].height() > 0);
  LUMIFOLD_CHECK(picture[0].width() == reference[0].width() && picture[0].height() == reference[0].height());
  const Picture a = MapColors(Shown(picture, exposure), YcxczFromRgb);
  const Picture b = MapColors(Shown(reference, exposure), YcxczFromRgb);
  Plane map = FeatureDifferences(a, b);
  const Picture lab_a = Perceived(a);
  const Picture lab_b = Perceived(b);
  ForEachPixel(map.width(), map.height(), [&](int x, int y) {
    const float color = ColorDifference({lab_a[0].At(x, y), lab_a[1].At(x, y), lab_a[2].At(x, y)},
                                        {lab_b[0].At(x, y), lab_b[1].At(x, y), lab_b[2].At(x, y)});
    map.At(x, y) = std::pow(color, 1.0f - map.At(x, y));
  });
  return map;
}

double Flip(const ConstColorView& picture, const ConstColorView& reference, float exposure) {
  return MeanOf(FlipMap(picture, reference, exposure).view());
}

}  // namespace lumifold::metrics
