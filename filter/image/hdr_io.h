#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"

namespace lumifold {

/// Whether the bytes start like a Radiance picture ("#?").
bool LooksLikeHdr(std::string_view bytes);

/// Decodes a Radiance picture (.hdr, RGBE or XYZE): flat scan lines, old and new run-length coding, any of
/// the eight orientations.
/// Shapes:  channels R, G, B, first row at the top.
/// Units:   as in the file, divided by its EXPOSURE=.
/// Errors:  kInvalidArgument beginning with `name` for anything that is not a complete picture
///          (truncated, runs that exceed their line, more than kMaxPixels).
/// Threads: safe.
/// Source:  Ward 1991, "Real Pixels"; Radiance's color.c format notes.
absl::StatusOr<LayeredImage> DecodeHdr(const std::string& name, std::string_view bytes);

}  // namespace lumifold
