#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

/// The bits of BasisLZ: fixed fields, chunked numbers and canonical Huffman codes, as in Deflate.
namespace lumifold::scene {

/// Reads the lowest bit of each byte first. A read that fails gives zeros; `ok` tells it afterwards, so that
/// loops of a known length check once.
/// Threads: one at a time.
class BitReader {
 public:
  explicit BitReader(std::string_view bytes)
      : rest_(bytes), bits_left_(8 * static_cast<int64_t>(bytes.size())) {}

  /// The next `count` bits, at most 32; zeros behind the end.
  uint32_t Peek(int count);
  void Skip(int count);
  uint32_t Read(int count);
  /// A number in chunks of `chunk_bits` bits, lowest first, each followed by a bit that says whether another
  /// one follows.
  uint64_t ReadChunked(int chunk_bits);

  void Fail() { failed_ = true; }
  /// Whether all that was read was there and valid.
  bool ok() const { return !failed_ && bits_left_ >= 0; }

 private:
  void Refill();

  std::string_view rest_;  // not yet in buffer_
  int64_t bits_left_;      // negative after reading behind the end
  uint64_t buffer_ = 0;
  int buffered_ = 0;  // bits
  bool failed_ = false;
};

/// A canonical Huffman code with lengths of at most 16 bits.
class HuffmanTable {
 public:
  /// An empty one: it decodes nothing.
  HuffmanTable() = default;

  /// Reads a table of at most 2^14 symbols. If it is damaged, `bits` fails.
  static HuffmanTable Read(BitReader* bits);

  /// The next symbol; if no code of the table follows, `bits` fails.
  uint32_t Decode(BitReader* bits) const;

 private:
  struct Entry {
    uint16_t symbol = 0;
    uint16_t length = 0;  // of its code; 0: there is none
  };

  static HuffmanTable FromLengths(const std::vector<uint8_t>& lengths, BitReader* bits);

  int index_bits_ = 0;          // the longest code
  std::vector<Entry> entries_;  // by the next index_bits_ bits; empty for an empty table
};

}  // namespace lumifold::scene
