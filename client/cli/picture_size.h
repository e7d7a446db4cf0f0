#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace lumifold::client {

/// Maximum width and height of a picture in pixels; the coordinator has the same limit.
inline constexpr int kMaxEdge = 16384;

struct PictureSize {
  int width = 1024;
  int height = 768;  // 0: as the camera's aspect ratio has it

  friend bool operator==(const PictureSize&, const PictureSize&) = default;
};

/// Parses "512x384", or a width alone.
/// Errors: kInvalidArgument with the expected format, for other text and for edges outside 1..kMaxEdge.
absl::StatusOr<PictureSize> ParsePictureSize(absl::string_view text);

}  // namespace lumifold::client
