#pragma once

#include <cstddef>
#include <vector>

#include "filter/image/rect.h"

namespace lumifold::filter {

/// What is known of each pixel of a band of rows and of the rows about it, found out once: windows about the
/// band's pixels read it many times.
/// Threads: reading is safe.
template <typename Pixel>
class BandPixels {
 public:
  /// Rows [y0, y1) of the frame, and `radius` more on either side where the frame has them. `find(x, y)`
  /// gives the pixel's.
  template <typename Find>
  BandPixels(const Rect& frame, int y0, int y1, int radius, const Find& find)
      : radius_(radius), area_(Inflate({frame.x0, y0, frame.x1, y1}, radius, frame)) {
    pixels_.reserve(static_cast<size_t>(area_.width()) * static_cast<size_t>(area_.height()));
    for (int y = area_.y0; y < area_.y1; ++y) {
      for (int x = area_.x0; x < area_.x1; ++x) pixels_.push_back(find(x, y));
    }
  }

  const Pixel& At(int x, int y) const {
    return pixels_[static_cast<size_t>(y - area_.y0) * static_cast<size_t>(area_.width()) +
                   static_cast<size_t>(x - area_.x0)];
  }

  /// The pixels within the radius of one of the band's, as far as there are any.
  Rect WindowAt(int x, int y) const { return Inflate({x, y, x + 1, y + 1}, radius_, area_); }

 private:
  int radius_;
  Rect area_;
  std::vector<Pixel> pixels_;
};

}  // namespace lumifold::filter
