#include "filter/image/plane.h"

#include <algorithm>
#include <cstring>
#include <new>

namespace lumifold {
namespace {

constexpr std::ptrdiff_t kFloatsPerLine = Plane::kAlignment / sizeof(float);

}  // namespace

Plane::Plane(int width, int height) : Plane(Uninitialized(width, height)) {
  if (data_ != nullptr)
    std::memset(data_.get(), 0, static_cast<size_t>(stride_) * static_cast<size_t>(height) * sizeof(float));
}

Plane Plane::Uninitialized(int width, int height) {
  LUMIFOLD_CHECK(width >= 0 && height >= 0);
  Plane plane;
  plane.width_ = width;
  plane.height_ = height;
  std::ptrdiff_t lines = (width + kFloatsPerLine - 1) / kFloatsPerLine;
  // Rows a power of two apart would map to few cache sets and evict each other.
  constexpr std::ptrdiff_t kCrowdedLines = 8;
  if (lines > 0 && lines % kCrowdedLines == 0) ++lines;
  plane.stride_ = lines * kFloatsPerLine;
  plane.Allocate(static_cast<size_t>(plane.stride_) * static_cast<size_t>(height));
  return plane;
}

Plane Plane::Packed(int width, int height) {
  LUMIFOLD_CHECK(width >= 0 && height >= 0);
  Plane plane;
  plane.width_ = width;
  plane.height_ = height;
  plane.stride_ = width;
  const size_t floats = static_cast<size_t>(width) * static_cast<size_t>(height);
  if (floats > 0) plane.Allocate((floats / kFloatsPerLine + 2) * kFloatsPerLine);
  return plane;
}

void Plane::Allocate(size_t floats) {
  if (floats == 0) return;
  data_.reset(static_cast<float*>(std::aligned_alloc(kAlignment, floats * sizeof(float))));
  if (data_ == nullptr) throw std::bad_alloc();
}

Plane Plane::Clone() const {
  Plane copy = stride_ == width_ ? Packed(width_, height_) : Uninitialized(width_, height_);
  CopyPlane(view(), copy.view());
  return copy;
}

void Plane::Truncate(int height) {
  LUMIFOLD_CHECK(height >= 0 && height <= height_);
  height_ = height;
}

void Plane::Fill(float value) {
  for (int y = 0; y < height_; ++y) std::fill_n(Row(y), width_, value);
}

void CopyPlane(ConstFloatView src, FloatView dst) {
  LUMIFOLD_CHECK(src.width() == dst.width() && src.height() == dst.height());
  for (int y = 0; y < src.height(); ++y) std::copy_n(src.Row(y), src.width(), dst.Row(y));
}

}  // namespace lumifold
