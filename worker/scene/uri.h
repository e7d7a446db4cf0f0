#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace lumifold::scene {

/// Replaces %XX by its byte (RFC 3986); a % without two hexadecimal digits is unchanged.
std::string PercentDecode(std::string_view text);

/// Whether `uri` contains its content (RFC 2397).
bool IsDataUri(std::string_view uri);

/// The content of a data URI, base64 or percent-encoded. Errors: kInvalidArgument, without the (long) URI.
absl::StatusOr<std::string> DecodeDataUri(std::string_view uri);

}  // namespace lumifold::scene
