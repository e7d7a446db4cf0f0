#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"

namespace lumifold {

/// Whether bytes begin as a Radiance picture's do ("#?").
bool LooksLikeHdr(std::string_view bytes);

/// Decodes a Radiance picture (.hdr, RGBE): flat scanlines, old and new run-length coding, any of the eight
/// orientations. Shapes: channels R, G, B, first row on top. Units: as in the file, EXPOSURE= taken out.
/// Errors: kInvalidArgument beginning with `name` for anything that is not a whole RGBE picture (XYZE, cut
/// short, runs that leave their line, more than kMaxPixels). Threads: safe. Source: Ward 1991, "Real Pixels";
/// Radiance's color.c format notes.
absl::StatusOr<LayeredImage> DecodeHdr(const std::string& name, std::string_view bytes);

}  // namespace lumifold
