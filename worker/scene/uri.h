#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace lumifold::scene {

/// Replaces %XX by its byte (RFC 3986); a % without two hexadecimal digits stays as it is.
std::string PercentDecode(std::string_view text);

/// Whether `uri` carries its content itself (RFC 2397).
bool IsDataUri(std::string_view uri);

/// The content of a data URI, base64 or percent-encoded. Errors: kInvalidArgument, without the (long) URI.
absl::StatusOr<std::string> DecodeDataUri(std::string_view uri);

}  // namespace lumifold::scene
