#include "worker/render/geometry/pixel_rows.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "filter/image/check.h"

namespace lumifold::render {

PixelRows::PixelRows(std::vector<std::string> channels, int width)
    : names_(std::move(channels)), width_(width), values_(names_.size()) {}

void PixelRows::Add(std::span<const float> values) {
  LUMIFOLD_CHECK(values.size() == values_.size());
  for (size_t i = 0; i < values.size(); ++i) values_[i].push_back(values[i]);
}

LayeredImage PixelRows::Make() const {
  const int rows = values_.empty() ? 0 : static_cast<int>(values_[0].size()) / width_;
  if (rows == 0) return {};
  LayeredImage list = LayeredImage::List(width_, rows);
  for (size_t i = 0; i < names_.size(); ++i) {
    const FloatView view = list.Add(names_[i]);
    for (int y = 0; y < rows; ++y) std::copy_n(values_[i].begin() + int64_t{y} * width_, width_, view.Row(y));
  }
  return list;
}

}  // namespace lumifold::render
