#include "filter/image/plane.h"

#include <algorithm>
#include <cstring>
#include <new>

namespace lumifold {

Plane::Plane(int width, int height) : Plane(Uninitialized(width, height)) {
  if (data_ != nullptr)
    std::memset(data_.get(), 0, static_cast<size_t>(stride_) * static_cast<size_t>(height) * sizeof(float));
}

Plane Plane::Uninitialized(int width, int height) {
  LUMIFOLD_CHECK(width >= 0 && height >= 0);
  Plane plane;
  plane.width_ = width;
  plane.height_ = height;
  constexpr std::ptrdiff_t kFloatsPerLine = kAlignment / sizeof(float);
  std::ptrdiff_t lines = (width + kFloatsPerLine - 1) / kFloatsPerLine;
  // Rows a power of two apart would map to few cache sets and evict each other.
  constexpr std::ptrdiff_t kCrowdedLines = 8;
  if (lines > 0 && lines % kCrowdedLines == 0) ++lines;
  plane.stride_ = lines * kFloatsPerLine;
  const size_t bytes = static_cast<size_t>(plane.stride_) * static_cast<size_t>(height) * sizeof(float);
  if (bytes == 0) return plane;
  plane.data_.reset(static_cast<float*>(std::aligned_alloc(kAlignment, bytes)));
  if (plane.data_ == nullptr) throw std::bad_alloc();
  return plane;
}

Plane Plane::Clone() const {
  Plane copy = Uninitialized(width_, height_);
  CopyPlane(view(), copy.view());
  return copy;
}

void Plane::Fill(float value) {
  for (int y = 0; y < height_; ++y) std::fill_n(Row(y), width_, value);
}

void CopyPlane(ConstFloatView src, FloatView dst) {
  LUMIFOLD_CHECK(src.width() == dst.width() && src.height() == dst.height());
  for (int y = 0; y < src.height(); ++y) std::copy_n(src.Row(y), src.width(), dst.Row(y));
}

}  // namespace lumifold
