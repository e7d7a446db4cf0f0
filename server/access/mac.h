#pragma once

#include <string>

#include "absl/strings/string_view.h"

namespace lumifold::access {

/// The HMAC-SHA256 of a text, in hexadecimal. `key`: secret bytes.
std::string MacOf(absl::string_view key, absl::string_view text);
/// Takes the same time whatever is wrong.
bool IsMacOf(absl::string_view mac, absl::string_view key, absl::string_view text);

}  // namespace lumifold::access
