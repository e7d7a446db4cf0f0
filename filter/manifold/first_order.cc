#include "filter/manifold/first_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "filter/image/check.h"
#include "filter/manifold/manifold_constants.h"

namespace lumifold::filter {
namespace {

constexpr size_t kColors = 3;

/// Position along one axis relative to the centre, in units.
float PositionOf(int pixel, int size, float unit_px) {
  return (static_cast<float>(pixel) - 0.5f * static_cast<float>(size - 1)) / unit_px;
}

/// Weighted means at one point, in the order of kMoments.
struct Moments {
  std::array<float, kColors> f;
  float x, y;
  std::array<float, kColors> xf, yf;
  float xx, xy, yy;
};

/// `read(k)`: the mean of signal k.
template <typename Read>
Moments ReadMoments(Read&& read) {
  return {{read(0), read(1), read(2)},  read(3),  read(4),  {read(5), read(6), read(7)},
          {read(8), read(9), read(10)}, read(11), read(12), read(13)};
}

/// The plane's value at (x0, y0): the mean light plus slope times the offset from the mean position. Samples
/// tell nothing of places far beyond them, where rounding would decide: an offset of more than
/// kMostDeviations deviations is cut to them.
std::array<float, kColors> PlaneAt(const Moments& m, float ridge, float x0, float y0) {
  // Far from the centre of a very wide picture, rounding may make variances negative.
  const float xx = std::max(m.xx - m.x * m.x, 0.0f) + ridge;
  const float yy = std::max(m.yy - m.y * m.y, 0.0f) + ridge;
  const float xy = m.xy - m.x * m.y;
  const float determinant = std::max(xx * yy - xy * xy, ridge * ridge);
  const float off_x = x0 - m.x;
  const float off_y = y0 - m.y;
  // Factors of the covariances with the light: the solution of a symmetric 2x2 system.
  float by_x = (off_x * yy - off_y * xy) / determinant;
  float by_y = (off_y * xx - off_x * xy) / determinant;
  const float deviations = std::sqrt(off_x * by_x + off_y * by_y);
  if (deviations > kMostDeviations) {
    by_x *= kMostDeviations / deviations;
    by_y *= kMostDeviations / deviations;
  }
  std::array<float, kColors> value;
  for (size_t c = 0; c < kColors; ++c)
    value[c] = m.f[c] + by_x * (m.xf[c] - m.x * m.f[c]) + by_y * (m.yf[c] - m.y * m.f[c]);
  return value;
}

}  // namespace

Planes Positions(int width, int height, float unit_px) {
  Planes positions = MakeUninitializedPlanes(2, width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) positions[0].At(x, y) = PositionOf(x, width, unit_px);
    std::fill_n(positions[1].Row(y), width, PositionOf(y, height, unit_px));
  }
  return positions;
}

void AddMoments(Planes* splat) {
  LUMIFOLD_CHECK(splat->size() == kPlaneSignals + 1);
  Planes planes = std::move(*splat);
  Plane weight = std::move(planes.back());
  planes.pop_back();
  for (size_t i = kPlaneSignals; i < kMoments; ++i)
    planes.push_back(Plane::Uninitialized(weight.width(), weight.height()));
  std::vector<float> x(static_cast<size_t>(weight.width())), y(x.size());
  for (int row = 0; row < weight.height(); ++row) {
    const float* w = weight.Row(row);
    const float* sum_x = planes[kColors].Row(row);
    const float* sum_y = planes[kColors + 1].Row(row);
    for (size_t i = 0; i < x.size(); ++i) {
      // Denormal weights have no finite inverse.
      const float inverse = w[i] >= std::numeric_limits<float>::min() ? 1.0f / w[i] : 0.0f;
      x[i] = sum_x[i] * inverse;
      y[i] = sum_y[i] * inverse;
    }
    size_t plane = kPlaneSignals;
    const auto put = [&](const std::vector<float>& place, const float* signal) {
      float* __restrict to = planes[plane++].Row(row);
      for (size_t i = 0; i < place.size(); ++i) to[i] = place[i] * signal[i];
    };
    for (size_t c = 0; c < kColors; ++c) put(x, planes[c].Row(row));
    for (size_t c = 0; c < kColors; ++c) put(y, planes[c].Row(row));
    put(x, sum_x);
    put(x, sum_y);
    put(y, sum_y);
  }
  planes.push_back(std::move(weight));
  *splat = std::move(planes);
}

Planes FitLight(const Planes& means, const Plane& x, const Plane& y, float ridge, TaskPool* pool) {
  Planes light = MakeUninitializedPlanes(kColors, x.width(), x.height());
  ForEachPixel(pool, x.width(), x.height(), [&](int i, int j) {
    const auto value =
        PlaneAt(ReadMoments([&](size_t k) { return means[k].At(i, j); }), ridge, x.At(i, j), y.At(i, j));
    for (size_t c = 0; c < kColors; ++c) light[c].At(i, j) = value[c];
  });
  return light;
}

}  // namespace lumifold::filter
