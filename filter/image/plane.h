#pragma once

#include <array>
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <type_traits>

#include "filter/image/check.h"
#include "filter/image/rect.h"

namespace lumifold {

/// A view of one channel: width x height values that another object owns, rows `stride` values apart. Copying
/// the view copies no pixels. T is float or const float in practice.
template <typename T>
class PlaneView {
 public:
  PlaneView() = default;
  PlaneView(T* data, int width, int height, std::ptrdiff_t stride)
      : data_(data), width_(width), height_(height), stride_(stride) {}

  /// A view of writable values converts to a view of constant values.
  operator PlaneView<const T>() const  // NOLINT(google-explicit-constructor): the safe direction
    requires(!std::is_const_v<T>)
  {
    return {data_, width_, height_, stride_};
  }

  int width() const { return width_; }
  int height() const { return height_; }
  std::ptrdiff_t stride() const { return stride_; }
  bool IsEmpty() const { return data_ == nullptr; }

  T* Row(int y) const { return data_ + y * stride_; }
  T& At(int x, int y) const { return data_[y * stride_ + x]; }

  /// The part inside `rect`, which must lie within the view.
  PlaneView Crop(const Rect& rect) const {
    LUMIFOLD_CHECK(rect.x0 >= 0 && rect.y0 >= 0 && rect.x1 <= width_ && rect.y1 <= height_);
    return {data_ + rect.y0 * stride_ + rect.x0, rect.width(), rect.height(), stride_};
  }

 private:
  T* data_ = nullptr;
  int width_ = 0;
  int height_ = 0;
  std::ptrdiff_t stride_ = 0;
};

using FloatView = PlaneView<float>;
using ConstFloatView = PlaneView<const float>;

/// Three planes of one colour or vector, in order R G B or X Y Z.
using ColorView = std::array<FloatView, 3>;
using ConstColorView = std::array<ConstFloatView, 3>;

/// Owns width x height floats, initially zero. Rows start on 64-byte boundaries, so that vector loads never
/// cross a cache line, and are padded to whole vectors, so that a kernel may read (but not use) values past
/// the last pixel. Move-only: Clone() copies.
class Plane {
 public:
  static constexpr int kAlignment = 64;

  Plane() = default;
  Plane(int width, int height);
  /// A plane of undefined values, to be written before it is read.
  static Plane Uninitialized(int width, int height);
  /// A plane of undefined values whose rows follow each other without padding: for lists, whose rows are
  /// short and no kernel's. Only the last one ends with a whole vector.
  static Plane Packed(int width, int height);

  /// A copy, padded or packed like this plane.
  Plane Clone() const;
  /// Drops the rows from `height` on, at most all; their memory is kept.
  void Truncate(int height);
  void Fill(float value);

  int width() const { return width_; }
  int height() const { return height_; }
  FloatView view() { return {data_.get(), width_, height_, stride_}; }
  ConstFloatView view() const { return {data_.get(), width_, height_, stride_}; }
  float* Row(int y) { return data_.get() + y * stride_; }
  const float* Row(int y) const { return data_.get() + y * stride_; }
  float& At(int x, int y) { return Row(y)[x]; }
  float At(int x, int y) const { return Row(y)[x]; }

 private:
  struct Free {
    void operator()(float* p) const { std::free(p); }
  };
  void Allocate(size_t floats);

  std::unique_ptr<float[], Free> data_;
  int width_ = 0;
  int height_ = 0;
  std::ptrdiff_t stride_ = 0;
};

/// Copies src into dst, which has the same size.
void CopyPlane(ConstFloatView src, FloatView dst);

}  // namespace lumifold
