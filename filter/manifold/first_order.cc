#include "filter/manifold/first_order.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "filter/image/check.h"

namespace lumifold::filter {
namespace {

constexpr float kMostDeviations =
    3;  // standard deviations of its samples from their mean at which a plane is read

/// Position along one axis relative to the centre, in units.
float PositionOf(int pixel, int size, float unit_px) {
  return (static_cast<float>(pixel) - 0.5f * static_cast<float>(size - 1)) / unit_px;
}

/// Calls write(c, value) with the value at (x0, y0) of the plane of each signal: the mean light plus slope
/// times the offset from the mean position. Samples tell nothing of places far beyond them, where rounding
/// would decide: an offset of more than kMostDeviations deviations is cut to them. `read(k)`: the mean of
/// moment k.
template <typename Read, typename Write>
void ReadPlanes(size_t signals, const Read& read, float ridge, float x0, float y0, const Write& write) {
  const size_t position = signals;
  const size_t products = position + 2;  // x f, then y f
  const size_t squares = products + 2 * signals;
  const float x = read(position);
  const float y = read(position + 1);
  // Far from the centre of a very wide picture, rounding may make variances negative.
  const float xx = std::max(read(squares) - x * x, 0.0f) + ridge;
  const float yy = std::max(read(squares + 2) - y * y, 0.0f) + ridge;
  const float xy = read(squares + 1) - x * y;
  const float determinant = std::max(xx * yy - xy * xy, ridge * ridge);
  const float off_x = x0 - x;
  const float off_y = y0 - y;
  // Factors of the covariances with the light: the solution of a symmetric 2x2 system.
  float by_x = (off_x * yy - off_y * xy) / determinant;
  float by_y = (off_y * xx - off_x * xy) / determinant;
  const float deviations = std::sqrt(off_x * by_x + off_y * by_y);
  if (deviations > kMostDeviations) {
    by_x *= kMostDeviations / deviations;
    by_y *= kMostDeviations / deviations;
  }
  for (size_t c = 0; c < signals; ++c) {
    const float f = read(c);
    write(c, f + by_x * (read(products + c) - x * f) + by_y * (read(products + signals + c) - y * f));
  }
}

size_t SignalsOf(size_t moments) { return (moments - 5) / 3; }

}  // namespace

Planes WithPosition(const Planes& light, float unit_px, TaskPool* pool) {
  const int width = light[0].width();
  const int height = light[0].height();
  const size_t signals = light.size();
  Planes planes = MakeUninitializedPlanes(signals + 2, width, height);
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (size_t c = 0; c < signals; ++c) std::copy_n(light[c].Row(y), width, planes[c].Row(y));
      for (int x = 0; x < width; ++x) planes[signals].At(x, y) = PositionOf(x, width, unit_px);
      std::fill_n(planes[signals + 1].Row(y), width, PositionOf(y, height, unit_px));
    }
  });
  return planes;
}

void AddMoments(Planes* splat) {
  LUMIFOLD_CHECK(splat->size() > 3);
  const size_t signals = splat->size() - 3;
  Planes planes = std::move(*splat);
  Plane weight = std::move(planes.back());
  planes.pop_back();
  while (planes.size() < MomentCount(signals))
    planes.push_back(Plane::Uninitialized(weight.width(), weight.height()));
  for (int row = 0; row < weight.height(); ++row) {
    for (int column = 0; column < weight.width(); ++column) {
      const float w = weight.At(column, row);
      // Denormal weights have no finite inverse.
      const float inverse = w >= std::numeric_limits<float>::min() ? 1.0f / w : 0.0f;
      const float sum_x = planes[signals].At(column, row);
      const float sum_y = planes[signals + 1].At(column, row);
      const float x = sum_x * inverse;
      const float y = sum_y * inverse;
      size_t plane = signals + 2;
      const auto put = [&](float value) { planes[plane++].At(column, row) = value; };
      for (size_t c = 0; c < signals; ++c) put(x * planes[c].At(column, row));
      for (size_t c = 0; c < signals; ++c) put(y * planes[c].At(column, row));
      put(x * sum_x);
      put(x * sum_y);
      put(y * sum_y);
    }
  }
  planes.push_back(std::move(weight));
  *splat = std::move(planes);
}

Planes FitLight(const Planes& means, float unit_px, float ridge, TaskPool* pool) {
  const int width = means[0].width();
  const int height = means[0].height();
  Planes light = MakeUninitializedPlanes(SignalsOf(means.size()), width, height);
  ForEachPixel(pool, width, height, [&](int x, int y) {
    ReadPlanes(
        light.size(), [&](size_t k) { return means[k].At(x, y); }, ridge, PositionOf(x, width, unit_px),
        PositionOf(y, height, unit_px), [&](size_t c, float value) { light[c].At(x, y) = value; });
  });
  return light;
}

SlicedPoints FitLightAtPoints(const SlicePoints& points, const SlicedPoints& means, float unit_px,
                              float ridge, int width, int height) {
  const size_t samples = points.samples;
  const size_t count = points.pixels.size();
  const size_t moments = count > 0 ? means.values.size() / (count * samples) : 0;
  const size_t signals = count > 0 ? SignalsOf(moments) : 0;
  SlicedPoints light{std::vector<float>(count * signals * samples), means.weights};
  for (size_t i = 0; i < count; ++i) {
    const float x = PositionOf(points.pixels[i][0], width, unit_px);
    const float y = PositionOf(points.pixels[i][1], height, unit_px);
    for (size_t j = 0; j < samples; ++j) {
      if (means.weights[i * samples + j] == 0) continue;
      ReadPlanes(
          signals, [&](size_t k) { return means.values[(i * moments + k) * samples + j]; }, ridge, x, y,
          [&](size_t c, float value) { light.values[(i * signals + c) * samples + j] = value; });
    }
  }
  return light;
}

}  // namespace lumifold::filter
