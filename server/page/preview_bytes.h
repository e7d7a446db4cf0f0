#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "lumifold/v1/farm.pb.h"

namespace lumifold::page {

/// A preview for a browser, compressed by gzip: 4 bytes with the length of a text in JSON, the text, and its
/// planes one after another, row by row from the top. All numbers have the lowest byte first.
///
/// The text has units, width, height, reduction, x0 and y0 of a region, preview_width, preview_height,
/// samples_per_pixel, finished, layers and, of each plane, channels and types: "half" for binary16, "float"
/// for binary32.
/// Errors: kInternal for a preview that is malformed.
absl::StatusOr<std::string> BytesOfPreview(const v1::Preview& preview);

}  // namespace lumifold::page
