#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/types/span.h"
#include "filter/image/color.h"
#include "filter/image/parallel.h"
#include "filter/image/plane.h"

namespace lumifold {

/// Several channels of one size.
using Planes = std::vector<Plane>;
/// R G B of a finished picture.
using Picture = std::array<Plane, 3>;

/// Rows a task works on. Sums over pixels are formed per band and added in band order, so that no result
/// depends on the pool; therefore this is part of the result's definition, not a tuning knob.
inline constexpr int kBandRows = 64;

inline int BandCount(int height) { return (height + kBandRows - 1) / kBandRows; }

/// Calls body(band, y0, y1) for each band of rows.
inline void ForEachBand(TaskPool* pool, int height, absl::FunctionRef<void(int, int, int)> body) {
  ParallelFor(pool, BandCount(height), [&](int64_t band) {
    const int y0 = static_cast<int>(band) * kBandRows;
    body(static_cast<int>(band), y0, std::min(y0 + kBandRows, height));
  });
}

/// Calls body(x, y) for each pixel, row by row on this thread.
template <typename Body>
void ForEachPixel(int width, int height, const Body& body) {
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) body(x, y);
  }
}

/// Calls body(x, y) for each pixel; bands of rows run side by side, so calls may share no state.
template <typename Body>
void ForEachPixel(TaskPool* pool, int width, int height, const Body& body) {
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < width; ++x) body(x, y);
    }
  });
}

/// The sum of row_sum(y) over all rows, added in a fixed order.
inline double SumRows(TaskPool* pool, int height, absl::FunctionRef<double(int)> row_sum) {
  std::vector<double> sums(static_cast<size_t>(BandCount(height)), 0.0);
  ForEachBand(pool, height, [&](int band, int y0, int y1) {
    for (int y = y0; y < y1; ++y) sums[static_cast<size_t>(band)] += row_sum(y);
  });
  double total = 0;
  for (const double sum : sums) total += sum;
  return total;
}

/// The one rule for values from outside: NaN, infinity and magnitudes above `largest` are unusable. The
/// default leaves room for a few products and sums of floats.
inline constexpr float kLargestUsable = 1e30f;
inline bool IsUsable(float value, float largest = kLargestUsable) { return std::abs(value) <= largest; }
/// The value where it is usable, else 0.
inline float UsableOr0(float value, float largest = kLargestUsable) {
  return IsUsable(value, largest) ? value : 0.0f;
}

/// `count` planes of zeros.
inline Planes MakePlanes(size_t count, int width, int height) {
  Planes planes;
  planes.reserve(count);
  for (size_t i = 0; i < count; ++i) planes.emplace_back(width, height);
  return planes;
}

/// The same, to be written before they are read: their values are anything.
inline Planes MakeUninitializedPlanes(size_t count, int width, int height) {
  Planes planes;
  planes.reserve(count);
  for (size_t i = 0; i < count; ++i) planes.push_back(Plane::Uninitialized(width, height));
  return planes;
}

/// A plane of one value.
inline Plane MakePlane(int width, int height, float value) {
  Plane plane = Plane::Uninitialized(width, height);
  plane.Fill(value);
  return plane;
}

/// A black picture.
inline Picture MakePicture(int width, int height) {
  return {Plane(width, height), Plane(width, height), Plane(width, height)};
}

inline Planes Clone(const Planes& planes) {
  Planes copy;
  copy.reserve(planes.size());
  for (const Plane& plane : planes) copy.push_back(plane.Clone());
  return copy;
}

inline Plane Clone(ConstFloatView view) {
  Plane copy = Plane::Uninitialized(view.width(), view.height());
  CopyPlane(view, copy.view());
  return copy;
}

/// The colour's planes, one after another.
inline Planes ClonePlanes(const ConstColorView& color) {
  Planes planes;
  for (const ConstFloatView& channel : color) planes.push_back(Clone(channel));
  return planes;
}

/// The colour as a picture of its own.
inline Picture ClonePicture(const ConstColorView& color) {
  return {Clone(color[0]), Clone(color[1]), Clone(color[2])};
}

/// Luminance of pixel (x, y) of three planes or views.
template <typename Color>
float LuminanceAt(const Color& color, int x, int y) {
  return Luminance(color[0].At(x, y), color[1].At(x, y), color[2].At(x, y));
}

/// sum += x, plane by plane.
inline void AddPlanes(absl::Span<const Plane> x, TaskPool* pool, absl::Span<Plane> sum) {
  ForEachBand(pool, sum[0].height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < sum.size(); ++c) {
      for (int y = y0; y < y1; ++y) {
        const float* __restrict in = x[c].Row(y);
        float* __restrict out = sum[c].Row(y);
        for (int i = 0; i < sum[c].width(); ++i) out[i] += in[i];
      }
    }
  });
}

/// Three planes as a colour.
inline ConstColorView ViewOf(absl::Span<const Plane> color) {
  return {color[0].view(), color[1].view(), color[2].view()};
}

/// The part of the colour inside `rect`.
inline ConstColorView Crop(const ConstColorView& color, const Rect& rect) {
  return {color[0].Crop(rect), color[1].Crop(rect), color[2].Crop(rect)};
}

}  // namespace lumifold
