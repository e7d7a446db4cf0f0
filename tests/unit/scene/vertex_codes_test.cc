#include "worker/scene/vertex_codes.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <vector>

#include "absl/strings/escaping.h"

namespace lumifold::scene {
namespace {

/// What the encoder of meshoptimizer 1.3 makes of words, and the word at element i, byte k.
struct Sample {
  const char* what;
  size_t count;
  size_t stride;
  const char* code;
  std::function<uint32_t(uint32_t i, size_t k)> word;
};

const std::vector<Sample>& Samples() {
  static const auto& samples = *new std::vector<Sample>{
      {"rotated differences and bytes", 40, 8,
       "a1baa50001050d19091d151111151d09190d050101050d19091d151111151d09190d050101050d19091d15152aaaaaaaaaaaa"
       "aaaaaaa00"
       "00152aaaaaaaaaaaaaaaaaaa000000000000000000000000000000000000003f0000cdab2200",
       [](uint32_t i, size_t k) {
         return k == 0 ? 0x3f000000 ^ ((i * i & 31) << 14) : 0xabcd0000 | (i * 257 & 0xffff);
       }},
      {"16-bit differences", 33, 4,
       "a177002f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f2f0a06888888888688888888886888888"
       "88801000800"
       "4ade8d069ad13d56ea8112a6c53162f6751eb2b9256efd692abead197af15d360a0002224444666888a8acacceeeefffff101"
       "010121001"
       "0014000000000000000000000000000000000000000000000000",
       [](uint32_t i, size_t) { return (i * 1000 & 0xffff) | (i * i * 37 & 0xffff) << 16; }},
      {"plain bytes", 19, 4,
       "a1ff009d9d9d9d9d9d9d9d9d9d9d9d9d9d9d9d9d9d00f4f4f2f4f4f2f4f4f2f4f4f2f4f4f4f2f4f4006e706e706e706e706e7"
       "06e706e706e"
       "706e7000c3c3c3c1c3c3c3c3c1c3c3c3c1c3c3c3c3c100000000000000000000000000000000000000b179379e00",
       [](uint32_t i, size_t) { return (i + 1) * 2654435761u; }},
      {"two blocks, of which one stays the same", 300, 4,
       "a1aa0001010006010100050101000301010001000000000000000000000000000000000000000403020100",
       [](uint32_t i, size_t) { return i >= 256 ? 7 : 0x01020304; }},
  };
  return samples;
}

std::string WordsOf(const Sample& sample) {
  std::string bytes;
  for (uint32_t i = 0; i < sample.count; ++i) {
    for (size_t k = 0; k < sample.stride; k += 4) {
      for (int shift = 0; shift < 32; shift += 8)
        bytes.push_back(static_cast<char>(sample.word(i, k) >> shift & 255));
    }
  }
  return bytes;
}

TEST(VertexCodes, AreThoseOfTheEncoder) {
  for (const Sample& sample : Samples()) {
    const std::string code = absl::HexStringToBytes(sample.code);
    EXPECT_TRUE(IsVertexCodeVersion1(code));
    std::string elements;
    EXPECT_TRUE(DecodeVertexCode(code, sample.count, sample.stride, &elements)) << sample.what;
    EXPECT_EQ(elements, WordsOf(sample)) << sample.what;
  }
}

TEST(VertexCodes, MustBeWholeAndNoLonger) {
  for (const Sample& sample : Samples()) {
    const std::string code = absl::HexStringToBytes(sample.code);
    std::string elements;
    for (size_t length = 0; length < code.size(); ++length)
      EXPECT_FALSE(DecodeVertexCode(code.substr(0, length), sample.count, sample.stride, &elements))
          << length;
    EXPECT_FALSE(
        DecodeVertexCode(code.substr(0, 9) + '\0' + code.substr(9), sample.count, sample.stride, &elements));
    EXPECT_FALSE(DecodeVertexCode(code, sample.count + 256, sample.stride, &elements));
    for (size_t i = 0; i < code.size(); ++i) {
      for (int bit = 0; bit < 8; ++bit) {
        std::string damaged = code;
        damaged[i] = static_cast<char>(damaged[i] ^ 1 << bit);
        DecodeVertexCode(damaged, sample.count, sample.stride,
                         &elements);  // whatever it says: no more than that
        EXPECT_LE(elements.size(), sample.count * sample.stride);
      }
    }
  }
}

TEST(VertexCodes, HaveThreeKindsOfChannels) {
  std::string code = absl::HexStringToBytes(Samples().back().code);
  std::string elements;
  for (const int mode : {3, 15, 0x10, 0x21}) {
    code.back() = static_cast<char>(mode);
    EXPECT_FALSE(DecodeVertexCode(code, 300, 4, &elements)) << mode;
  }
}

}  // namespace
}  // namespace lumifold::scene
