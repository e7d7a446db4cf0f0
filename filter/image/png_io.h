#pragma once

#include <string>

#include "absl/status/status.h"
#include "filter/image/plane.h"

namespace lumifold {

/// Writes linear RGB as an 8-bit sRGB PNG: value = round(255 * srgb(exposure * linear)); NaN becomes black.
/// Appears whole or not at all. Errors: kInvalidArgument on an empty picture; kUnavailable when the disk
/// refuses.
absl::Status WritePng(const std::string& path, const ConstColorView& linear, float exposure = 1.0f);

}  // namespace lumifold
