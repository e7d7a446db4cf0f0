#pragma once

#include <span>
#include <string>
#include <vector>

#include "filter/image/layered_image.h"

namespace lumifold::render {

/// Collects the values of a list whose length is not known before: an edge set or fragments, see EdgedImage.
class PixelRows {
 public:
  /// A list of this width.
  PixelRows(std::vector<std::string> channels, int width);

  /// Adds the next value of every channel, in their order: `width` calls make a row.
  void Add(std::span<const float> values);

  /// The complete rows; without channels if there are none.
  LayeredImage Make() const;

 private:
  std::vector<std::string> names_;
  int width_;
  std::vector<std::vector<float>> values_;  // by channel
};

}  // namespace lumifold::render
