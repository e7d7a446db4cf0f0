#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "filter/image/planes.h"
#include "filter/image/rect.h"
#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {

/// Sums over the (2 radius + 1)^2 window around each pixel of a block, of terms that are computed row by row:
/// no plane of the picture's size holds them. A sum depends on nothing outside its window.
/// Edges:   the window is cut at the picture's edge.
/// Threads: holds scratch memory, so one object for each task.
template <size_t terms>
class WindowSums {
 public:
  /// Columns of a block: the rows of a window stay in the first-level cache.
  static constexpr int kColumns = 128;
  using Rows = std::array<float*, terms>;
  using ConstRows = std::array<const float*, terms>;

  explicit WindowSums(int radius)
      : radius_(radius),
        stride_(kColumns + 2 * radius),
        ones_(static_cast<size_t>(2 * radius + 1), 1.0f),
        line_(terms * static_cast<size_t>(stride_)),
        lines_(line_.size() * static_cast<size_t>(kBandRows + 2 * radius)),
        sums_(line_.size()) {}

  /// Takes a block of at most kColumns x kBandRows pixels. load(y, x0, x1, rows) writes term k of the pixels
  /// [x0, x1) of row y, inside the picture, from rows[k] on.
  template <typename Load>
  void Take(const Rect& block, const Rect& picture, const Load& load) {
    block_ = block;
    const Rect apron = Inflate(block, radius_, picture);
    const std::ptrdiff_t margin = apron.x0 - block.x0 + radius_;
    std::fill(line_.begin(), line_.end(), 0.0f);
    for (int y = block.y0 - radius_; y < block.y1 + radius_; ++y) {
      if (y < apron.y0 || y >= apron.y1) {
        std::fill_n(Line(y), line_.size(), 0.0f);
        continue;
      }
      Rows rows;
      for (size_t k = 0; k < terms; ++k) rows[k] = line_.data() + Offset(k) + margin;
      load(y, apron.x0, apron.x1, rows);
      for (size_t k = 0; k < terms; ++k) {
        const float* from = line_.data() + Offset(k);
        CorrelateRows({ones_.data(), 2 * radius_ + 1, &from, 1, block.width()}, Line(y) + Offset(k));
      }
    }
  }

  /// The sums of each term around the pixels of row y of the block; valid until the next call.
  ConstRows Row(int y) {
    ConstRows rows;
    std::vector<const float*> from(ones_.size());
    for (size_t k = 0; k < terms; ++k) {
      for (size_t i = 0; i < from.size(); ++i) from[i] = Line(y - radius_ + static_cast<int>(i)) + Offset(k);
      float* to = sums_.data() + Offset(k);
      CorrelateRows({ones_.data(), 1, from.data(), from.size(), block_.width()}, to);
      rows[k] = to;
    }
    return rows;
  }

 private:
  std::ptrdiff_t Offset(size_t term) const { return static_cast<std::ptrdiff_t>(term) * stride_; }
  /// Sums along row y.
  float* Line(int y) {
    return lines_.data() + (y - block_.y0 + radius_) * static_cast<std::ptrdiff_t>(line_.size());
  }

  int radius_;
  int stride_;
  Rect block_ = {};
  std::vector<float> ones_;
  std::vector<float> line_;   // terms of one row
  std::vector<float> lines_;  // of each row of the block and its apron: sums along the row
  std::vector<float> sums_;   // of one row
};

}  // namespace lumifold::filter
