#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"

namespace lumifold {

/// Decodes a picture of linear light, OpenEXR or Radiance (.hdr), which are told apart by their first bytes.
/// Shapes: channels R, G, B; an OpenEXR picture with only Y becomes grey.
/// Errors: those of DecodeExr() and DecodeHdr(); kInvalidArgument if it is neither, or has no colour. They
///         begin with `name`.
absl::StatusOr<LayeredImage> DecodeLinearPicture(const std::string& name, std::string_view bytes);

}  // namespace lumifold
