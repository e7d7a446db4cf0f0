#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/plane.h"

namespace lumifold {

/// Writes linear RGB as an 8-bit sRGB PNG: value = round(255 * srgb(exposure * linear)); NaN becomes black.
/// Appears whole or not at all. Errors: kInvalidArgument on an empty picture; kUnavailable when the disk
/// refuses.
absl::Status WritePng(const std::string& path, const ConstColorView& linear, float exposure = 1.0f);

/// WritePng for a picture whose rows come some at a time from the top down; 3 bytes a pixel are kept until
/// Finish().
class PngRowWriter {
 public:
  PngRowWriter(std::string path, int width, int height, float exposure);
  /// The next rows, of the picture's width.
  void Append(const ConstColorView& linear);
  /// Writes the file; all rows must have come. Errors: as WritePng.
  absl::Status Finish() const;

 private:
  std::string path_;
  int width_;
  int height_;
  float exposure_;
  std::vector<uint8_t> bytes_;
};

}  // namespace lumifold
