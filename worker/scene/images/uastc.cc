#include "worker/scene/images/uastc.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace lumifold::scene {
namespace {

constexpr int kTexels = 16;
constexpr int kMaxSubsets = 3;

/// How endpoints are quantised: a digit in a base of 1 (no digit), 3 or 5, and bits. An endpoint with a digit
/// is digit * step + spread of its upper bits; the lowest bit mirrors it.
struct EndpointRange {
  uint32_t base;
  int bits;
  uint32_t step;
  uint32_t multiplier, shift;  // spread(x) = x * multiplier + (x >> shift)
};

constexpr EndpointRange k12 = {3, 2, 93, 0x116, 1};
constexpr EndpointRange k16 = {1, 4, 0, 0, 0};
constexpr EndpointRange k32 = {1, 5, 0, 0, 0};
constexpr EndpointRange k40 = {5, 3, 26, 130, 1};
constexpr EndpointRange k48 = {3, 4, 22, 65, 3};
constexpr EndpointRange k160 = {5, 5, 6, 32, 3};
constexpr EndpointRange k192 = {3, 6, 5, 16, 4};
constexpr EndpointRange k256 = {1, 8, 0, 0, 0};

// Bits of hints for other formats, which are skipped.
constexpr int kOpaqueHints = 15, kAlphaHints = 23, kShortAlphaHints = 17;

struct Mode {
  uint32_t code;  // the lowest bits of a block
  int code_bits;
  int hint_bits;
  int components;  // 2: luminance and alpha
  int subsets;
  int planes;  // 2: one component has weights of its own
  int weight_bits;
  EndpointRange range;
};

constexpr int kThreeSubsetMode = 3, kSecondPatternsMode = 7, kSolidMode = 8, kLuminancePlanesMode = 17;
constexpr Mode kModes[] = {
    {0x01, 4, kOpaqueHints, 3, 1, 1, 4, k192},
    {0x35, 6, kOpaqueHints, 3, 1, 1, 2, k256},
    {0x1d, 5, kOpaqueHints, 3, 2, 1, 3, k16},
    {0x03, 5, kOpaqueHints, 3, 3, 1, 2, k12},
    {0x13, 5, kOpaqueHints, 3, 2, 1, 2, k40},
    {0x0b, 5, kOpaqueHints, 3, 1, 1, 3, k256},
    {0x1b, 5, kOpaqueHints, 3, 1, 2, 2, k160},
    {0x07, 5, kOpaqueHints, 3, 2, 1, 2, k40},
    {0x17, 5, 0, 4, 1, 1, 0, k256},
    {0x0f, 5, kAlphaHints, 4, 2, 1, 2, k16},
    {0x02, 3, kShortAlphaHints, 4, 1, 1, 4, k48},
    {0x00, 2, kShortAlphaHints, 4, 1, 2, 2, k48},
    {0x06, 3, kShortAlphaHints, 4, 1, 1, 3, k192},
    {0x1f, 5, kAlphaHints, 4, 1, 2, 1, k256},
    {0x0d, 5, kAlphaHints, 4, 1, 1, 2, k256},
    {0x05, 7, kAlphaHints, 2, 1, 1, 4, k256},
    {0x15, 6, kAlphaHints, 2, 2, 1, 2, k256},
    {0x25, 6, kAlphaHints, 2, 1, 2, 2, k256},
    {0x09, 4, kOpaqueHints, 3, 1, 1, 5, k32},
};
constexpr int kModeCount = static_cast<int>(std::size(kModes));
constexpr int kMaxCodeBits = 7;

// The texels of subset 1, lowest bit first.
constexpr uint16_t kTwoSubsets[] = {
    0xcccc, 0x8888, 0x1111, 0xecc8, 0x377f, 0xfeec, 0x0137, 0x137f, 0xc800, 0x0013,
    0xfe80, 0x17ff, 0x0017, 0x00ff, 0xfff0, 0x0fff, 0xff71, 0x8eff, 0x08ce, 0x008c,
    0x7310, 0xceff, 0x7331, 0x088c, 0xceef, 0x6666, 0xf00f, 0x5555, 0x0f0f, 0x36c9,
};
constexpr uint16_t kSecondTwoSubsets[] = {
    0x00f0, 0x4444, 0x0133, 0xcc80, 0xf0ff, 0x2222, 0xffc8, 0xccce, 0x3c03, 0x00ee,
    0x7700, 0x3003, 0x00ce, 0xff80, 0x6fff, 0x1333, 0x11ff, 0x136c, 0x00ef,
};
// The texels of subsets 1 and 2.
constexpr uint16_t kThreeSubsets[][2] = {
    {0x3300, 0xcc00}, {0x00ff, 0xf000}, {0x000f, 0xf000}, {0x000f, 0x00f0},
    {0x3333, 0x4444}, {0x6666, 0x8888}, {0xcccc, 0x2222}, {0xee00, 0x1111},
    {0x4444, 0x9999}, {0xf00f, 0x0f00}, {0x0cc0, 0xc00c},
};

/// The mode of each value of the lowest bits of a block; kModeCount where there is none.
constexpr std::array<uint8_t, 1 << kMaxCodeBits> MakeModeTable() {
  std::array<uint8_t, 1 << kMaxCodeBits> table = {};
  for (uint32_t bits = 0; bits < table.size(); ++bits) {
    table[bits] = kModeCount;
    for (int m = 0; m < kModeCount; ++m) {
      if ((bits & ((1u << kModes[m].code_bits) - 1)) == kModes[m].code) table[bits] = static_cast<uint8_t>(m);
    }
  }
  return table;
}

/// `value` of `from` bits, repeated to fill `to` bits.
constexpr uint32_t Replicate(uint32_t value, int from, int to) {
  uint32_t filled = 0;
  for (int shift = to - from; shift > -from; shift -= from)
    filled |= shift >= 0 ? value << shift : value >> -shift;
  return filled;
}

constexpr int kMaxWeightBits = 5;
using WeightTable = std::array<std::array<uint8_t, 1 << kMaxWeightBits>, kMaxWeightBits + 1>;

/// Weights in 64ths, by the number of bits and the stored value.
constexpr WeightTable MakeWeightTable() {
  WeightTable table = {};
  for (int bits = 1; bits <= kMaxWeightBits; ++bits) {
    for (uint32_t value = 0; value < 1u << bits; ++value) {
      const uint32_t weight = Replicate(value, bits, 6);
      table[bits][value] = static_cast<uint8_t>(weight > 32 ? weight + 1 : weight);
    }
  }
  return table;
}

constexpr std::array<uint8_t, 1 << kMaxCodeBits> kModeOfBits = MakeModeTable();
constexpr WeightTable kWeights = MakeWeightTable();

uint64_t LoadLittleEndian(const char* bytes) {
  uint64_t value = 0;
  for (int i = 7; i >= 0; --i) value = value << 8 | static_cast<uint8_t>(bytes[i]);
  return value;
}

/// The bits of one block from the lowest.
class BlockBits {
 public:
  explicit BlockBits(const char* block) : low_(LoadLittleEndian(block)), high_(LoadLittleEndian(block + 8)) {}

  uint32_t Read(int count) {
    const uint32_t value = static_cast<uint32_t>(low_) & ((1u << count) - 1);
    Skip(count);
    return value;
  }

  void Skip(int count) {
    if (count == 0) return;
    low_ = low_ >> count | high_ << (64 - count);
    high_ >>= count;
  }

 private:
  uint64_t low_, high_;
};

using Texel = std::array<uint8_t, 4>;
using Block = std::array<Texel, kTexels>;

/// The lower and the upper endpoint of each component, of 16 bits.
struct Subset {
  std::array<uint32_t, 4> low, high;
};

uint32_t Unquantized(const EndpointRange& range, uint32_t bits, uint32_t digit) {
  if (range.base == 1) return Replicate(bits, range.bits, 8);
  const uint32_t upper = bits >> 1, mirror = (bits & 1) != 0 ? 0x1ff : 0;
  const uint32_t value = (digit * range.step + upper * range.multiplier + (upper >> range.shift)) ^ mirror;
  return (mirror & 0x80) | value >> 2;
}

/// Reads the digits of all endpoints, several to a number, then their bits.
std::array<uint8_t, 18> ReadEndpoints(const EndpointRange& range, int count, BlockBits* bits) {
  constexpr int kBitsOfTrits[] = {0, 2, 4, 5, 7, 8}, kBitsOfQuints[] = {0, 3, 5, 7};
  std::array<uint32_t, 18> digits = {};
  const int group = range.base == 3 ? 5 : 3;
  for (int first = 0; range.base != 1 && first < count; first += group) {
    const int grouped = std::min(group, count - first);
    uint32_t packed = bits->Read(range.base == 3 ? kBitsOfTrits[grouped] : kBitsOfQuints[grouped]);
    for (int i = 0; i < grouped; ++i, packed /= range.base) digits[first + i] = packed % range.base;
  }
  std::array<uint8_t, 18> endpoints = {};
  for (int i = 0; i < count; ++i)
    endpoints[i] = static_cast<uint8_t>(Unquantized(range, bits->Read(range.bits), digits[i]));
  return endpoints;
}

std::array<Subset, kMaxSubsets> ReadSubsets(const Mode& mode, BlockBits* bits) {
  const auto endpoints = ReadEndpoints(mode.range, 2 * mode.components * mode.subsets, bits);
  std::array<Subset, kMaxSubsets> subsets;
  const uint8_t* next = endpoints.data();
  for (int s = 0; s < mode.subsets; ++s) {
    for (int c = 0; c < 4; ++c) {
      const bool repeats_luminance = mode.components == 2 && (c == 1 || c == 2);
      const bool is_opaque = mode.components == 3 && c == 3;
      if (repeats_luminance) next -= 2;
      subsets[s].low[c] = is_opaque ? 0xffff : next[0] * 0x101u;
      subsets[s].high[c] = is_opaque ? 0xffff : next[1] * 0x101u;
      if (!is_opaque) next += 2;
    }
  }
  return subsets;
}

/// The subset of each texel. False if there is no such pattern.
bool ReadPattern(int mode, BlockBits* bits, std::array<uint8_t, kTexels>* subset_of) {
  uint32_t first = 0, second = 0;
  if (mode == kThreeSubsetMode) {
    const uint32_t pattern = bits->Read(4);
    if (pattern >= std::size(kThreeSubsets)) return false;
    first = kThreeSubsets[pattern][0];
    second = kThreeSubsets[pattern][1];
  } else if (kModes[mode].subsets == 2) {
    const uint32_t pattern = bits->Read(5);
    const bool is_second = mode == kSecondPatternsMode;
    if (pattern >= (is_second ? std::size(kSecondTwoSubsets) : std::size(kTwoSubsets))) return false;
    first = is_second ? kSecondTwoSubsets[pattern] : kTwoSubsets[pattern];
  }
  for (int i = 0; i < kTexels; ++i)
    (*subset_of)[i] = static_cast<uint8_t>((first >> i & 1) + 2 * (second >> i & 1));
  return true;
}

bool DecodeBlock(const char* bytes, Block* block) {
  BlockBits bits(bytes);
  const int mode_index = kModeOfBits[static_cast<uint8_t>(bytes[0]) & ((1 << kMaxCodeBits) - 1)];
  if (mode_index == kModeCount) return false;
  const Mode& mode = kModes[mode_index];
  bits.Skip(mode.code_bits);
  if (mode_index == kSolidMode) {
    Texel color;
    for (uint8_t& channel : color) channel = static_cast<uint8_t>(bits.Read(8));
    block->fill(color);
    return true;
  }
  bits.Skip(mode.hint_bits);
  std::array<uint8_t, kTexels> subset_of;
  if (!ReadPattern(mode_index, &bits, &subset_of)) return false;
  int second_plane = 4;  // the component that it is for; 4: none
  if (mode.planes == 2)
    second_plane = mode_index == kLuminancePlanesMode ? 3 : static_cast<int>(bits.Read(2));
  const std::array<Subset, kMaxSubsets> subsets = ReadSubsets(mode, &bits);
  uint32_t seen = 0;  // subsets
  for (int i = 0; i < kTexels; ++i) {
    // The highest bit of the first weight of each subset is 0 and is not stored.
    const bool is_first = (seen >> subset_of[i] & 1) == 0;
    seen |= 1u << subset_of[i];
    const int weight_bits = mode.weight_bits - (is_first ? 1 : 0);
    const uint32_t weight = kWeights[mode.weight_bits][bits.Read(weight_bits)];
    std::array<uint32_t, 4> weights = {weight, weight, weight, weight};
    if (mode.planes == 2) {
      const uint32_t other = kWeights[mode.weight_bits][bits.Read(weight_bits)];
      if (second_plane < 4) weights[second_plane] = other;
    }
    const Subset& subset = subsets[subset_of[i]];
    for (int c = 0; c < 4; ++c) {
      const uint32_t mixed = subset.low[c] * (64 - weights[c]) + subset.high[c] * weights[c];
      (*block)[i][c] = static_cast<uint8_t>((mixed + 32) >> 14);
    }
  }
  return true;
}

}  // namespace

absl::Status DecodeUastc(std::string_view blocks, ImageData* image) {
  const int columns = (image->width + 3) / 4, rows = (image->height + 3) / 4;
  if (static_cast<int64_t>(blocks.size()) != int64_t{kUastcBlockBytes} * columns * rows)
    return absl::InvalidArgumentError("damaged KTX2: its level has not the bytes of its pixels");
  Block block;
  for (int y = 0; y < image->height; y += 4) {
    for (int x = 0; x < image->width; x += 4) {
      if (!DecodeBlock(blocks.data(), &block))
        return absl::InvalidArgumentError(absl::StrCat("damaged KTX2: no picture at pixel ", x, ",", y));
      blocks.remove_prefix(kUastcBlockBytes);
      const size_t row_bytes = 4 * static_cast<size_t>(std::min(4, image->width - x));
      for (int row = 0; row < std::min(4, image->height - y); ++row) {
        const size_t first =
            static_cast<size_t>(y + row) * static_cast<size_t>(image->width) + static_cast<size_t>(x);
        std::memcpy(image->rgba.data() + 4 * first, block[4 * static_cast<size_t>(row)].data(), row_bytes);
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace lumifold::scene
