#include "proto/rpc/plane_compression.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zstd.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>

#include "tests/support/peak_memory.h"

namespace lumifold::rpc {
namespace {

using ::testing::HasSubstr;

Plane SmoothPlane(int width, int height) {
  Plane plane(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) plane.At(x, y) = std::sqrt(1.0f + static_cast<float>(x + 3 * y));
  }
  return plane;
}

std::string Compressed(const Plane& plane) {
  std::string bytes;
  EXPECT_GT(PlaneCompressor().Append(plane.view(), &bytes), 0u);
  return bytes;
}

std::string Frame(const std::string& content) {
  std::string bytes(ZSTD_compressBound(content.size()), '\0');
  bytes.resize(ZSTD_compress(bytes.data(), bytes.size(), content.data(), content.size(), 1));
  return bytes;
}

/// A frame of so many MiB of zeros, which says so at its beginning or does not.
std::string Bomb(int megabytes, bool says_size) {
  const std::string zeros(size_t{1} << 20, '\0');
  std::string bytes(size_t{1} << 20, '\0');
  ZSTD_outBuffer out = {bytes.data(), bytes.size(), 0};
  ZSTD_CCtx* context = ZSTD_createCCtx();
  if (says_size) ZSTD_CCtx_setPledgedSrcSize(context, static_cast<uint64_t>(megabytes) << 20);
  for (int i = 1; i <= megabytes; ++i) {
    ZSTD_inBuffer in = {zeros.data(), zeros.size(), 0};
    const ZSTD_EndDirective end = i == megabytes ? ZSTD_e_end : ZSTD_e_continue;
    size_t left = 1;
    while (in.pos < in.size || (end == ZSTD_e_end && left > 0))
      left = ZSTD_compressStream2(context, &out, &in, end);
  }
  ZSTD_freeCCtx(context);
  return bytes.substr(0, out.pos);
}

std::string ErrorOf(const std::string& bytes, int width = 8, int height = 4) {
  Plane plane(width, height);
  const absl::Status status = DecompressPlane(bytes, plane.view());
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  return std::string(status.message());
}

TEST(PlaneCompression, KeepsEveryBit) {
  PlaneCompressor compressor;
  std::mt19937 random(1);
  for (const int width : {5, 16, 33, 257}) {  // rows of a plane are padded in memory
    for (const int height : {9, 32}) {
      Plane plane = SmoothPlane(width, height);
      plane.At(1, 2) = std::numeric_limits<float>::quiet_NaN();
      plane.At(2, 2) = -0.0f;
      plane.At(3, 2) = std::numeric_limits<float>::denorm_min();
      plane.At(4, 2) = -std::numeric_limits<float>::infinity();
      std::string bytes = "before";
      const uint32_t size = compressor.Append(plane.view(), &bytes);
      ASSERT_GT(size, 0u);
      ASSERT_EQ(bytes.size(), 6 + size);
      EXPECT_LT(size, static_cast<size_t>(width * height) * sizeof(float));
      Plane decoded(width, height);
      ASSERT_TRUE(DecompressPlane(std::string_view(bytes).substr(6), decoded.view()).ok());
      for (int y = 0; y < height; ++y)
        EXPECT_EQ(std::memcmp(plane.Row(y), decoded.Row(y), static_cast<size_t>(width) * sizeof(float)), 0);
    }
  }
}

TEST(PlaneCompression, APlaneThatWouldNotShrinkIsNotCompressed) {
  std::mt19937 random(1);
  Plane plane(16, 16);
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x) {
      const auto bits = static_cast<uint32_t>(random());
      std::memcpy(&plane.At(x, y), &bits, sizeof(bits));
    }
  }
  std::string bytes = "before";
  EXPECT_EQ(PlaneCompressor().Append(plane.view(), &bytes), 0u);
  EXPECT_EQ(bytes, "before");
  Plane single(1, 1);
  EXPECT_EQ(PlaneCompressor().Append(single.view(), &bytes), 0u);
}

TEST(PlaneCompression, RefusesWhatIsNotOneFrameOfThePlane) {
  const std::string good = Compressed(SmoothPlane(8, 4));
  for (size_t size = 0; size < good.size(); ++size) ErrorOf(good.substr(0, size));
  EXPECT_EQ(ErrorOf(good + good), "not one zstd frame");
  EXPECT_EQ(ErrorOf(good + "x"), "not one zstd frame");
  EXPECT_EQ(ErrorOf("no frame"), "not one zstd frame");
  const std::string skipped("\x50\x2a\x4d\x18\x04\0\0\0skip", 12);
  EXPECT_EQ(ErrorOf(skipped), "not one zstd frame");
  EXPECT_EQ(ErrorOf(skipped + good), "not one zstd frame");
  const std::string old("\x27\xb5\x2f\xfd\x01\0\0\0\0\0\0\0", 12);  // zstd 0.7
  EXPECT_EQ(ErrorOf(old), "not one zstd frame");
  EXPECT_EQ(ErrorOf(Frame(std::string(127, 'a'))), "127 bytes of values, not 128");
  EXPECT_EQ(ErrorOf(Frame("")), "0 bytes of values, not 128");
  EXPECT_THAT(ErrorOf(Frame(std::string(129, 'a'))), HasSubstr("too small"));
}

TEST(PlaneCompression, ABombTakesNoMoreMemoryThanThePlane) {
  for (const bool says_size : {false, true}) {
    const std::string bomb = Bomb(512, says_size);
    ASSERT_LT(bomb.size(), size_t{64} << 10);
    const int64_t before = PeakMemoryBytes();
    EXPECT_THAT(ErrorOf(bomb, 512, 512), HasSubstr("too small"));
    EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes);
  }
}

TEST(PlaneCompression, AnyDamageEndsInAStatus) {
  const std::string good = Compressed(SmoothPlane(16, 16));
  std::mt19937 random(2);
  Plane plane(16, 16);
  for (int repeat = 0; repeat < 2000; ++repeat) {
    std::string bad = good;
    bad[random() % bad.size()] = static_cast<char>(random());
    (void)DecompressPlane(bad, plane.view());
  }
  EXPECT_TRUE(DecompressPlane(good, plane.view()).ok()) << "a thread goes on after errors";
}

}  // namespace
}  // namespace lumifold::rpc
