#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/plane.h"

struct ZSTD_CCtx_s;

/// PLANE_ENCODING_ZSTD: the bytes of a plane's float32 values, sorted into byte planes (byte 0 of all values,
/// then bytes 1, 2 and 3), as one zstd frame. Signs and exponents of neighbouring pixels are alike, the low
/// bytes of the mantissas are noise: sorted, the former compress.
namespace lumifold::rpc {

/// Compresses planes. The bytes depend on the version of zstd; what they decode to does not.
/// Threads: one at a time.
class PlaneCompressor {
 public:
  /// Appends the compressed plane to `bytes` if it is smaller than float32. Returns its size; 0 where it is
  /// not, and then nothing is appended.
  uint32_t Append(ConstFloatView plane, std::string* bytes);

 private:
  struct Free {
    void operator()(ZSTD_CCtx_s* context) const;
  };
  std::unique_ptr<ZSTD_CCtx_s, Free> context_;  // null before the first plane
  std::vector<char> sorted_;
};

/// Decodes a plane. What it needs for it, 160 KB and the bytes of the largest plane so far, whatever the
/// bytes claim, stays with the thread: a unit is many small planes.
/// Errors: kInvalidArgument where `bytes` are not one zstd frame of as many values; the plane is then
/// undefined.
/// Threads: safe.
absl::Status DecompressPlane(std::string_view bytes, FloatView plane);

}  // namespace lumifold::rpc
