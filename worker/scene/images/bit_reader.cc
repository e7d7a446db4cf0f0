#include "worker/scene/images/bit_reader.h"

#include <algorithm>
#include <array>

namespace lumifold::scene {
namespace {

constexpr int kMaxCodeBits = 16;

// Symbols of the code for code lengths: 0 to 16 are lengths, the others are runs.
enum RunSymbol : uint32_t { kShortZeros = 17, kLongZeros, kShortRepeat, kLongRepeat, kLengthSymbols };

// The order in which the lengths of that code are stored.
constexpr uint8_t kLengthOrder[kLengthSymbols] = {17, 18, 19, 20, 0,  8, 7,  9, 6,  10, 5,
                                                  11, 4,  12, 3,  13, 2, 14, 1, 15, 16};

/// How often a run's length is repeated.
size_t ReadRun(uint32_t symbol, BitReader* bits) {
  switch (symbol) {
    case kShortZeros:
      return bits->Read(3) + 3;
    case kLongZeros:
      return bits->Read(7) + 11;
    case kShortRepeat:
      return bits->Read(2) + 3;
    default:
      return bits->Read(7) + 7;
  }
}

uint32_t Reversed(uint32_t code, int length) {
  uint32_t reversed = 0;
  for (int i = 0; i < length; ++i) reversed |= (code >> i & 1) << (length - 1 - i);
  return reversed;
}

}  // namespace

void BitReader::Refill() {
  while (buffered_ <= 56 && !rest_.empty()) {
    buffer_ |= static_cast<uint64_t>(static_cast<uint8_t>(rest_.front())) << buffered_;
    rest_.remove_prefix(1);
    buffered_ += 8;
  }
}

uint32_t BitReader::Peek(int count) {
  if (buffered_ < count) Refill();
  return static_cast<uint32_t>(buffer_ & ((uint64_t{1} << count) - 1));
}

void BitReader::Skip(int count) {
  if (buffered_ < count) Refill();
  buffer_ >>= count;
  buffered_ = std::max(buffered_ - count, 0);
  bits_left_ -= count;
}

uint32_t BitReader::Read(int count) {
  const uint32_t value = Peek(count);
  Skip(count);
  return value;
}

uint64_t BitReader::ReadChunked(int chunk_bits) {
  uint64_t value = 0;
  for (int shift = 0; shift < 32; shift += chunk_bits) {
    value |= static_cast<uint64_t>(Read(chunk_bits)) << shift;
    if (Read(1) == 0) return value;
  }
  Fail();
  return 0;
}

HuffmanTable HuffmanTable::Read(BitReader* bits) {
  const size_t symbols = bits->Read(14);
  if (symbols == 0) return HuffmanTable();
  const uint32_t stored = bits->Read(5);
  if (stored == 0 || stored > kLengthSymbols) bits->Fail();
  std::vector<uint8_t> code_lengths(kLengthSymbols);
  for (uint32_t i = 0; i < stored && bits->ok(); ++i)
    code_lengths[kLengthOrder[i]] = static_cast<uint8_t>(bits->Read(3));
  const HuffmanTable code = FromLengths(code_lengths, bits);
  std::vector<uint8_t> lengths;
  while (lengths.size() < symbols && bits->ok()) {
    const uint32_t symbol = code.Decode(bits);
    if (symbol <= kMaxCodeBits) {
      lengths.push_back(static_cast<uint8_t>(symbol));
      continue;
    }
    const bool repeats = symbol >= kShortRepeat;
    if (repeats && (lengths.empty() || lengths.back() == 0)) bits->Fail();
    const uint8_t length = repeats && !lengths.empty() ? lengths.back() : uint8_t{0};
    lengths.insert(lengths.end(), ReadRun(symbol, bits), length);
  }
  if (lengths.size() != symbols) bits->Fail();
  return FromLengths(lengths, bits);
}

HuffmanTable HuffmanTable::FromLengths(const std::vector<uint8_t>& lengths, BitReader* bits) {
  HuffmanTable table;
  if (!bits->ok()) return table;
  std::array<uint32_t, kMaxCodeBits + 1> of_length = {}, next_code = {};
  for (const uint8_t length : lengths) ++of_length[length];
  const uint32_t used = static_cast<uint32_t>(lengths.size()) - of_length[0];
  if (used == 0) return table;
  of_length[0] = 0;
  uint32_t code = 0;
  for (int length = 1; length <= kMaxCodeBits; ++length) {
    code = (code + of_length[length - 1]) << 1;
    next_code[length] = code;
    if (of_length[length] != 0) table.index_bits_ = length;
  }
  // A code of one symbol has one bit that is not used; any other leaves nothing over.
  if (used != 1 && code + of_length[kMaxCodeBits] != 1u << kMaxCodeBits) {
    bits->Fail();
    return table;
  }
  table.entries_.resize(size_t{1} << table.index_bits_);
  for (size_t symbol = 0; symbol < lengths.size(); ++symbol) {
    const int length = lengths[symbol];
    if (length == 0) continue;
    for (size_t i = Reversed(next_code[length]++, length); i < table.entries_.size();
         i += size_t{1} << length)
      table.entries_[i] = {static_cast<uint16_t>(symbol), static_cast<uint16_t>(length)};
  }
  return table;
}

uint32_t HuffmanTable::Decode(BitReader* bits) const {
  const Entry entry = entries_.empty() ? Entry() : entries_[bits->Peek(index_bits_)];
  if (entry.length == 0) bits->Fail();
  bits->Skip(entry.length);
  return entry.symbol;
}

}  // namespace lumifold::scene
