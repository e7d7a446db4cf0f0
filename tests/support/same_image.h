#pragma once

#include <gtest/gtest.h>

#include "filter/image/layered_image.h"

namespace lumifold {

/// Both have the same channels, in any order, with the same values.
inline void ExpectSameImage(const LayeredImage& image, const LayeredImage& expected) {
  ASSERT_EQ(image.bounds(), expected.bounds());
  ASSERT_EQ(image.channels().size(), expected.channels().size());
  for (const LayeredImage::Channel& channel : expected.channels()) {
    ASSERT_TRUE(image.Has(channel.name)) << channel.name;
    const ConstFloatView view = image.Get(channel.name);
    for (int y = 0; y < expected.height(); ++y) {
      for (int x = 0; x < expected.width(); ++x)
        ASSERT_EQ(view.At(x, y), channel.plane.At(x, y)) << channel.name << " at " << x << ',' << y;
    }
  }
}

}  // namespace lumifold
