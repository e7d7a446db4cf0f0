#include "filter/kernels/box_mean.h"

#include <algorithm>
#include <utility>

#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {
namespace {

/// The most columns of a block: what it and its apron take stays in the second-level cache.
constexpr int kBlockColumns = 256;

/// A block of pixels with an apron of `radius` around it, row after row, zero beyond the picture, and sums
/// over windows of it.
class Window {
 public:
  Window(int width, int height, int radius)
      : radius_(radius),
        stride_(width + 2 * radius),
        values_(static_cast<size_t>(stride_ * (height + 2 * radius))),
        scratch_(values_.size()),
        sums_(values_.size()) {}

  /// Copies `weight`, times `values` unless that is empty.
  void Load(const Rect& block, ConstFloatView values, ConstFloatView weight) {
    std::fill(values_.begin(), values_.end(), 0.0f);
    const Rect apron = Inflate(block, radius_, {0, 0, weight.width(), weight.height()});
    for (int y = apron.y0; y < apron.y1; ++y) {
      const std::ptrdiff_t first =
          std::ptrdiff_t{y - block.y0 + radius_} * stride_ + (apron.x0 - block.x0 + radius_);
      float* out = values_.data() + first;
      const float* by = weight.Row(y) + apron.x0;
      if (values.IsEmpty())
        std::copy_n(by, apron.width(), out);
      else
        AddProductRow(values.Row(y) + apron.x0, by, apron.width(), out);
    }
  }

  /// Sums of windows whose first pixel stands where their centre's block pixel is: row y of the block.
  void Sum() {
    SumAlong(1);
    SumAlong(stride_);
  }
  const float* Row(int y) const { return values_.data() + static_cast<std::ptrdiff_t>(y) * stride_; }

 private:
  /// values_[i] = values_[i] + values_[i + stride] + ... , 2 radius + 1 of them: powers of two by doubling,
  /// as many as the binary digits of the window's side ask for, so that a sum depends on nothing outside its
  /// window.
  void SumAlong(int stride) {
    const int side = 2 * radius_ + 1;
    const int count = static_cast<int>(values_.size());
    int done = 1;  // the side is odd: every sum begins with its own value
    std::copy(values_.begin(), values_.end(), sums_.begin());
    for (int length = 1; 2 * length <= side; length *= 2) {
      SumRows(values_.data(), values_.data() + length * stride, std::max(0, count - length * stride),
              scratch_.data());
      std::swap(values_, scratch_);  // sums of 2 * length values
      if ((side & (2 * length)) == 0) continue;
      SumRows(sums_.data(), values_.data() + done * stride, std::max(0, count - done * stride),
              scratch_.data());
      std::swap(sums_, scratch_);
      done += 2 * length;
    }
    std::swap(values_, sums_);
  }

  int radius_;
  int stride_;
  std::vector<float> values_;
  std::vector<float> scratch_;
  std::vector<float> sums_;
};

/// One block of all means.
void BlockMeans(const Rect& block, const Planes& values, ConstFloatView weight, Window* total, Window* window,
                Planes* means) {
  total->Load(block, {}, weight);
  total->Sum();
  for (size_t i = 0; i < values.size(); ++i) {
    window->Load(block, values[i].view(), weight);
    window->Sum();
    for (int y = block.y0; y < block.y1; ++y) {
      const float* __restrict sum = window->Row(y - block.y0);
      const float* __restrict mass = total->Row(y - block.y0);
      float* __restrict mean = (*means)[i].Row(y) + block.x0;
      for (int x = 0; x < block.width(); ++x) {
        const float quotient = sum[x] / mass[x];
        mean[x] = mass[x] > 0 ? quotient : 0.0f;
      }
    }
  }
}

}  // namespace

Planes BoxMeans(const Planes& values, ConstFloatView weight, int radius, TaskPool* pool) {
  const int width = weight.width();
  const int height = weight.height();
  // A window over the whole picture reaches no further.
  const int reach = std::min(radius, std::max(width, height));
  const int blocks = std::max(1, (width + kBlockColumns - 1) / kBlockColumns);
  const int columns = (width + blocks - 1) / blocks;
  Planes means = MakeUninitializedPlanes(values.size(), width, height);
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    Window total(columns, y1 - y0, reach);
    Window window(columns, y1 - y0, reach);
    for (int x0 = 0; x0 < width; x0 += columns)
      BlockMeans({x0, y0, std::min(x0 + columns, width), y1}, values, weight, &total, &window, &means);
  });
  return means;
}

}  // namespace lumifold::filter
