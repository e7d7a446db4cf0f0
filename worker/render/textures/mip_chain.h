#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// The transfer function of texels: linear value of each code of 8 or 16 bits, and its inverse.
class TransferTable {
 public:
  /// `srgb`: codes are sRGB-encoded; else linear value = code / the largest code.
  explicit TransferTable(bool srgb);

  float Decode(uint8_t code) const { return linear_[code]; }
  float Decode(uint16_t code) const {
    return deep_ != nullptr ? deep_[code] : static_cast<float>(code) / 65535.0f;
  }
  /// The code whose linear value is nearest; of 16 bits the one next to its encoded value.
  void Encode(float linear, uint8_t* code) const;
  void Encode(float linear, uint16_t* code) const;

 private:
  static constexpr int kSteps = 4096;  // a power of two: the step of a value is exact

  float linear_[256];
  const float* deep_ = nullptr;  // of sRGB codes: the linear values of 16 bits; lives as long as the program
  uint8_t above_[kSteps + 1];    // the first code from 1 on whose linear value is not below that of the step
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
