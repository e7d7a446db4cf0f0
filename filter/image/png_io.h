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

/// Writes rows of 8-bit RGB, 3 bytes for each pixel, or with 4 bytes of RGBA, not premultiplied, as PNG.
/// Errors: as WritePng.
absl::Status WritePngBytes(const std::string& path, int width, int height, const std::vector<uint8_t>& bytes);

}  // namespace lumifold
