#pragma once

#include <algorithm>

namespace lumifold {

/// A half-open rectangle of pixels, [x0, x1) x [y0, y1), in picture coordinates (origin top left, y down).
struct Rect {
  int x0 = 0;
  int y0 = 0;
  int x1 = 0;
  int y1 = 0;

  constexpr int width() const { return x1 - x0; }
  constexpr int height() const { return y1 - y0; }
  constexpr bool IsEmpty() const { return x1 <= x0 || y1 <= y0; }
  constexpr bool Contains(int x, int y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }

  friend constexpr bool operator==(const Rect&, const Rect&) = default;
};

/// The common part of a and b; empty if they do not overlap.
constexpr Rect Intersect(const Rect& a, const Rect& b) {
  return {std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1), std::min(a.y1, b.y1)};
}

/// The rectangle in coordinates whose origin is (x, y).
constexpr Rect SeenFrom(int x, int y, const Rect& r) { return {r.x0 - x, r.y0 - y, r.x1 - x, r.y1 - y}; }

/// r, extended by an apron of `px` on each side and cropped to `bounds`.
constexpr Rect Inflate(const Rect& r, int px, const Rect& bounds) {
  return Intersect({r.x0 - px, r.y0 - px, r.x1 + px, r.y1 + px}, bounds);
}

}  // namespace lumifold
