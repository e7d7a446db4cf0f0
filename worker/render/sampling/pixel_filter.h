#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>

namespace lumifold::render {

/// Which points of the picture a pixel is a mean of: a product of the same even function of x and y about the
/// pixel's centre. Random numbers are mapped to points of its density, so that all samples count equally and
/// each belongs to one pixel: tiles stay independent, and means, halves and variances are what they are for a
/// box.
/// Source: Ernst, Stamminger and Greiner 2006, "Filter Importance Sampling".
class PixelFilter {
 public:
  enum class Kind { kBox, kGaussian, kBlackmanHarris };

  /// A box one pixel wide: the pixel itself.
  PixelFilter() = default;
  /// `width` in pixels, above 0: the function is 0 beyond half of it. A Gaussian has a standard deviation of
  /// a quarter of it.
  PixelFilter(Kind kind, float width);

  float width() const { return width_; }

  /// Distance from the pixel's left or upper border, in pixels: `u` of [0, 1) mapped to the density. 0.5 is
  /// the pixel's centre; a box one pixel wide maps every number to itself.
  float Warp(float u) const {
    if (table_ == nullptr) return width_ == 1 ? u : 0.5f + (u - 0.5f) * width_;
    const float place = u * kSteps;
    const auto step = std::min(static_cast<size_t>(place), kSteps - 1);
    const float from = (*table_)[step];
    return 0.5f + from + ((*table_)[step + 1] - from) * (place - static_cast<float>(step));
  }

 private:
  static constexpr size_t kSteps = 8192;  // the tails of the widest are a small part of the last one
  /// Distances from the centre at which the integral of the function is i / kSteps of the whole.
  using Table = std::array<float, kSteps + 1>;

  float width_ = 1;
  std::shared_ptr<const Table> table_;  // null: a box
};

}  // namespace lumifold::render
