#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// The transfer function of 8-bit texels: linear value of each of the 256 codes, and its inverse.
class TransferTable {
 public:
  /// `srgb`: codes are sRGB-encoded; else linear value = code / 255.
  explicit TransferTable(bool srgb);

  float Decode(uint8_t code) const { return linear_[code]; }
  /// The code whose linear value is nearest.
  uint8_t Encode(float linear) const;

 private:
  static constexpr int kSteps = 4096;  // a power of two: the step of a value is exact

  float linear_[256];
  uint8_t above_[kSteps + 1];  // the first code from 1 on whose linear value is not below that of the step
};

using MipLevels = std::vector<scene::ImageData>;
using SharedMips = std::shared_ptr<const MipLevels>;
/// Returns MakeMips of a picture, made now or kept from an earlier scene.
using MipSource = std::function<SharedMips(const scene::SharedImage& image, bool srgb)>;

/// The mip levels of a picture without the picture itself, each half as wide and high as the one before
/// (rounded down, at least 1), down to a single texel. A texel is the mean of the linear values over the area
/// it covers. `color` decodes red, green and blue, `alpha` the alpha channel. All levels together take a
/// third of the picture's memory.
MipLevels MakeMipChain(const scene::ImageData& image, const TransferTable& color, const TransferTable& alpha);

/// MakeMipChain of a picture whose colour is sRGB-encoded or linear; its alpha is linear.
MipLevels MakeMips(const scene::ImageData& image, bool srgb);

}  // namespace lumifold::render
