#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"

namespace lumifold::local {

/// Implements client::DisplayedReader.
absl::StatusOr<LayeredImage> ReadDisplayed(const std::string& path);

}  // namespace lumifold::local
