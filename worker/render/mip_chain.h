#pragma once

#include <cstdint>
#include <vector>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// The light that each of an image's 256 byte values stands for, and back.
class ByteCode {
 public:
  /// `srgb`: the colour is encoded; else values are fractions of 255.
  explicit ByteCode(bool srgb);

  float Decode(uint8_t code) const { return light_[code]; }
  /// The nearest code, as light goes.
  uint8_t Encode(float light) const;

 private:
  float light_[256];
};

/// Ever smaller copies of a picture, each half as wide and high (rounded down, at least 1) down to a single
/// texel: texels are means over the area they cover, of light and not of its code. `color` decodes red, green
/// and blue; alpha is linear. The picture itself is not among them: together they take a third of its memory.
std::vector<scene::ImageData> MakeMipChain(const scene::ImageData& image, const ByteCode& color,
                                           const ByteCode& alpha);

}  // namespace lumifold::render
