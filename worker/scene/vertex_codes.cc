#include "worker/scene/vertex_codes.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <optional>

namespace lumifold::scene {
namespace {

constexpr char kVersion1 = '\xa1';
constexpr size_t kMinTailBytes = 24;
constexpr size_t kGroup = 16;  // elements whose deltas are coded together
constexpr size_t kMostElements = 256;

/// The deltas of one byte of the elements of a block.
using Deltas = std::array<uint8_t, kMostElements>;

/// Takes bytes from the front of a stream.
class CodeReader {
 public:
  explicit CodeReader(std::string_view bytes) : rest_(bytes) {}

  bool IsAtEnd() const { return rest_.empty(); }
  /// Null if there are not so many.
  const uint8_t* Take(size_t count) {
    if (count > rest_.size()) return nullptr;
    const auto* taken = reinterpret_cast<const uint8_t*>(rest_.data());
    rest_.remove_prefix(count);
    return taken;
  }

 private:
  std::string_view rest_;
};

/// A group of deltas of 1, 2 or 4 bits, of which the largest value stands for a byte behind them.
bool ReadPacked(CodeReader* code, int bits, uint8_t* out) {
  const uint8_t* const packed = code->Take(kGroup * static_cast<size_t>(bits) / 8);
  if (packed == nullptr) return false;
  const int per_byte = 8 / bits;
  const int sentinel = (1 << bits) - 1;
  for (int i = 0; i < static_cast<int>(kGroup); ++i) {
    const int place = i % per_byte;
    const int shift = bits == 1 ? place : 8 - bits * (place + 1);  // single bits begin at the lowest one
    const int value = packed[i / per_byte] >> shift & sentinel;
    out[i] = static_cast<uint8_t>(value);
    if (value != sentinel) continue;
    const uint8_t* const whole = code->Take(1);
    if (whole == nullptr) return false;
    out[i] = *whole;
  }
  return true;
}

/// `lengths`: bits of the deltas of a group by its two bits of header.
bool ReadGroups(CodeReader* code, size_t groups, const std::array<int, 4>& lengths, Deltas* out) {
  const uint8_t* const header = code->Take((groups + 3) / 4);
  if (header == nullptr) return false;
  for (size_t group = 0; group < groups; ++group) {
    uint8_t* const deltas = out->data() + group * kGroup;
    const int bits = lengths[header[group / 4] >> 2 * (group % 4) & 3];
    if (bits == 0) {
      std::fill_n(deltas, kGroup, uint8_t{0});
    } else if (bits == 8) {
      const uint8_t* const whole = code->Take(kGroup);
      if (whole == nullptr) return false;
      std::copy_n(whole, kGroup, deltas);
    } else if (!ReadPacked(code, bits, deltas)) {
      return false;
    }
  }
  return true;
}

bool ReadDeltas(CodeReader* code, int control, size_t elements, Deltas* out) {
  const size_t groups = (elements + kGroup - 1) / kGroup;
  if (control == 0) return ReadGroups(code, groups, {0, 1, 2, 4}, out);
  if (control == 1) return ReadGroups(code, groups, {1, 2, 4, 8}, out);
  if (control == 2) {
    out->fill(0);
    return true;
  }
  const uint8_t* const literal = code->Take(elements);
  if (literal == nullptr) return false;
  std::copy_n(literal, elements, out->data());
  return true;
}

template <typename T>
T Unzigzag(T value) {
  return static_cast<T>((value & 1) != 0 ? ~(value >> 1) : value >> 1);
}

/// How four bytes of an element follow from those of the element before it.
class Channel {
 public:
  static std::optional<Channel> Of(uint8_t mode) {
    const int kind = mode & 15;
    const int rotation = mode >> 4;
    if (kind > 2 || (kind < 2 && rotation != 0)) return std::nullopt;
    return Channel(kind, rotation);
  }

  uint32_t Next(uint32_t last, uint32_t delta) const {
    if (kind_ == 2) return last ^ std::rotr(delta, rotation_);
    uint32_t next = 0;
    if (kind_ == 1) {
      for (int shift = 0; shift < 32; shift += 16) {
        const auto step = Unzigzag(static_cast<uint16_t>(delta >> shift));
        next |= uint32_t{static_cast<uint16_t>((last >> shift) + step)} << shift;
      }
      return next;
    }
    for (int shift = 0; shift < 32; shift += 8) {
      const auto step = Unzigzag(static_cast<uint8_t>(delta >> shift));
      next |= uint32_t{static_cast<uint8_t>((last >> shift) + step)} << shift;
    }
    return next;
  }

 private:
  Channel(int kind, int rotation) : kind_(kind), rotation_(rotation) {}

  int kind_;
  int rotation_;
};

uint32_t Word(const uint8_t* bytes) {
  return uint32_t{bytes[0]} | uint32_t{bytes[1]} << 8 | uint32_t{bytes[2]} << 16 | uint32_t{bytes[3]} << 24;
}

/// Decodes the blocks of a stream.
class VertexDecoder {
 public:
  VertexDecoder(std::string_view blocks, size_t stride, std::string* elements)
      : code_(blocks), stride_(stride), out_(reinterpret_cast<uint8_t*>(elements->data())) {}

  /// `tail`: the element before the first one, and the channels' modes.
  bool Run(const uint8_t* tail, size_t count) {
    std::memcpy(last_.data(), tail, stride_);
    for (size_t i = 0; i < stride_ / 4; ++i) {
      const std::optional<Channel> channel = Channel::Of(tail[stride_ + i]);
      if (!channel.has_value()) return false;
      channels_[i] = channel;
    }
    const size_t most = std::min(8192 / stride_ & ~(kGroup - 1), kMostElements);
    for (size_t done = 0; done < count; done += most) {
      if (!ReadBlock(std::min(most, count - done))) return false;
    }
    return code_.IsAtEnd();
  }

 private:
  bool ReadBlock(size_t elements) {
    const uint8_t* const controls = code_.Take(stride_ / 4);
    if (controls == nullptr) return false;
    for (size_t channel = 0; channel < stride_ / 4; ++channel) {
      for (size_t byte = 0; byte < 4; ++byte) {
        const int control = controls[channel] >> 2 * byte & 3;
        if (!ReadDeltas(&code_, control, elements, &deltas_[byte])) return false;
      }
      AddDeltas(channel, elements);
    }
    out_ += elements * stride_;
    return true;
  }

  void AddDeltas(size_t channel, size_t elements) {
    uint8_t* const last = last_.data() + 4 * channel;
    uint32_t value = Word(last);
    uint8_t* out = out_ + 4 * channel;
    for (size_t i = 0; i < elements; ++i, out += stride_) {
      const uint8_t delta[4] = {deltas_[0][i], deltas_[1][i], deltas_[2][i], deltas_[3][i]};
      value = channels_[channel]->Next(value, Word(delta));
      for (int byte = 0; byte < 4; ++byte) out[byte] = static_cast<uint8_t>(value >> 8 * byte);
    }
    for (int byte = 0; byte < 4; ++byte) last[byte] = static_cast<uint8_t>(value >> 8 * byte);
  }

  CodeReader code_;
  const size_t stride_;
  uint8_t* out_;
  std::array<std::optional<Channel>, 64> channels_;
  std::array<uint8_t, 256> last_ = {};  // the element before the block
  std::array<Deltas, 4> deltas_ = {};
};

}  // namespace

bool IsVertexCodeVersion1(std::string_view code) { return !code.empty() && code.front() == kVersion1; }

bool DecodeVertexCode(std::string_view code, size_t count, size_t stride, std::string* elements) {
  elements->clear();
  const size_t tail_bytes = stride + stride / 4;
  const size_t padded = std::max(tail_bytes, kMinTailBytes);
  if (!IsVertexCodeVersion1(code) || code.size() < 1 + padded) return false;
  const auto* const tail = reinterpret_cast<const uint8_t*>(code.data()) + code.size() - tail_bytes;
  elements->assign(count * stride, '\0');
  return VertexDecoder(code.substr(1, code.size() - 1 - padded), stride, elements).Run(tail, count);
}

}  // namespace lumifold::scene
