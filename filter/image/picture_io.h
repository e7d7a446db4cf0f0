#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"

namespace lumifold {

/// Decodes a picture of linear light, OpenEXR or Radiance (.hdr), told apart by its first bytes. Shapes:
/// channels R, G, B; an OpenEXR picture that has Y alone becomes grey. Errors: those of DecodeExr() and
/// DecodeHdr(); kInvalidArgument where it is neither, or has no colour. `name` is what errors call it.
absl::StatusOr<LayeredImage> DecodeLinearPicture(const std::string& name, std::string_view bytes);

}  // namespace lumifold
