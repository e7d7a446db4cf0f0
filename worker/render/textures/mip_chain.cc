#include "worker/render/textures/mip_chain.h"

#include <algorithm>
#include <cmath>

#include "filter/image/color.h"

namespace lumifold::render {
namespace {

/// The texels of the larger level that one texel of the smaller level covers along one axis: `count` texels
/// from `first` on, with weights of sum 1. As sizes are halved and rounded down, its extent is at
/// most 3 texels.
struct Span {
  int first = 0;
  int count = 0;
  float weight[4] = {};
};

std::vector<Span> SpansOf(int size, int half) {
  std::vector<Span> spans(static_cast<size_t>(half));
  for (int i = 0; i < half; ++i) {
    const double step = static_cast<double>(size) / half;
    const double begin = i * step;
    const double end = (i + 1) * step;
    Span& span = spans[i];
    span.first = static_cast<int>(begin);
    for (int k = span.first; k < size && k < end && span.count < 4; ++k) {
      const double covered = std::min(end, k + 1.0) - std::max(begin, static_cast<double>(k));
      span.weight[span.count++] = static_cast<float>(covered / step);
    }
  }
  return spans;
}

/// Sets the codes of `half`, a picture of half the size.
template <typename Code>
void Halve(const scene::ImageData& image, const TransferTable& color, const TransferTable& alpha,
           const scene::ImageData& half, std::vector<Code>* codes) {
  codes->resize(static_cast<size_t>(half.width) * half.height * 4);
  const std::vector<Span> columns = SpansOf(image.width, half.width);
  const std::vector<Span> rows = SpansOf(image.height, half.height);
  Code* out = codes->data();
  for (const Span& row : rows) {
    for (const Span& column : columns) {
      float sum[4] = {};
      for (int y = 0; y < row.count; ++y) {
        const Code* in =
            &image.codes<Code>()[(static_cast<size_t>(row.first + y) * image.width + column.first) * 4];
        for (int x = 0; x < column.count; ++x, in += 4) {
          const float weight = row.weight[y] * column.weight[x];
          for (int c = 0; c < 3; ++c) sum[c] += weight * color.Decode(in[c]);
          sum[3] += weight * alpha.Decode(in[3]);
        }
      }
      for (int c = 0; c < 3; ++c) color.Encode(sum[c], out++);
      alpha.Encode(sum[3], out++);
    }
  }
}

scene::ImageData Half(const scene::ImageData& image, const TransferTable& color, const TransferTable& alpha) {
  scene::ImageData half;
  half.width = std::max(image.width / 2, 1);
  half.height = std::max(image.height / 2, 1);
  if (image.is_deep())
    Halve(image, color, alpha, half, &half.rgba16);
  else
    Halve(image, color, alpha, half, &half.rgba);
  return half;
}

/// The linear values of all sRGB codes of 16 bits.
const std::vector<float>& DeepSrgb() {
  static const std::vector<float> values = [] {
    std::vector<float> made(65536);
    for (size_t i = 0; i < made.size(); ++i) made[i] = LinearFromSrgb(static_cast<float>(i) / 65535.0f);
    return made;
  }();
  return values;
}

}  // namespace

TransferTable::TransferTable(bool srgb) {
  for (int i = 0; i < 256; ++i) {
    const float fraction = static_cast<float>(i) / 255.0f;
    linear_[i] = srgb ? LinearFromSrgb(fraction) : fraction;
  }
  int above = 1;
  for (int i = 0; i <= kSteps; ++i) {
    while (above < 255 && linear_[above] < static_cast<float>(i) / kSteps) ++above;
    above_[i] = static_cast<uint8_t>(above);
  }
  if (srgb) deep_ = DeepSrgb().data();
}

void TransferTable::Encode(float linear, uint16_t* code) const {
  const float encoded = deep_ != nullptr ? SrgbFromLinear(linear) : std::clamp(linear, 0.0f, 1.0f);
  *code = static_cast<uint16_t>(encoded * 65535.0f + 0.5f);
}

void TransferTable::Encode(float linear, uint8_t* code) const {
  const float* above = linear_ + above_[static_cast<int>(std::clamp(linear, 0.0f, 1.0f) * kSteps)];
  while (above < linear_ + 255 && *above < linear) ++above;  // once at most: codes are more than a step apart
  const bool nearer_below = linear - above[-1] < above[0] - linear;
  *code = static_cast<uint8_t>(above - linear_ - (nearer_below ? 1 : 0));
}

MipLevels MakeMipChain(const scene::ImageData& image, const TransferTable& color,
                       const TransferTable& alpha) {
  MipLevels chain;
  const scene::ImageData* last = &image;
  while (last->width > 1 || last->height > 1) {
    scene::ImageData half = Half(*last, color, alpha);
    chain.push_back(std::move(half));
    last = &chain.back();
  }
  return chain;
}

MipLevels MakeMips(const scene::ImageData& image, bool srgb) {
  const TransferTable linear(/*srgb=*/false);
  return srgb ? MakeMipChain(image, TransferTable(/*srgb=*/true), linear)
              : MakeMipChain(image, linear, linear);
}

}  // namespace lumifold::render
