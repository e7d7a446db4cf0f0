#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace lumifold::client {

/// The longest edge a picture may have, in pixels; the coordinator holds to the same.
inline constexpr int kMaxEdge = 16384;

struct PictureSize {
  int width = 1024;
  int height = 768;

  friend bool operator==(const PictureSize&, const PictureSize&) = default;
};

/// Reads "512x384". Errors: kInvalidArgument that says what is expected, for anything else and for edges
/// outside 1..kMaxEdge.
absl::StatusOr<PictureSize> ParsePictureSize(absl::string_view text);

}  // namespace lumifold::client
