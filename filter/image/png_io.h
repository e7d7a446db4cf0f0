#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/plane.h"

namespace lumifold {

/// Writes linear RGB as an 8-bit sRGB PNG: value = round(255 * srgb(exposure * linear)); NaN becomes black.
/// The file is written atomically.
/// Errors: kInvalidArgument for an empty picture; kUnavailable if the file cannot be written.
absl::Status WritePng(const std::string& path, const ConstColorView& linear, float exposure = 1.0f);

/// WritePng for a picture whose rows arrive some at a time, from the top down. Keeps 3 bytes per pixel in
/// memory until Finish().
class PngRowWriter {
 public:
  PngRowWriter(std::string path, int width, int height, float exposure);
  /// The next rows, of the picture's width.
  void Append(const ConstColorView& linear);
  /// Writes the file. All rows must have been appended.
  /// Errors: as WritePng.
  absl::Status Finish() const;

 private:
  std::string path_;
  int width_;
  int height_;
  float exposure_;
  std::vector<uint8_t> bytes_;
};

}  // namespace lumifold
