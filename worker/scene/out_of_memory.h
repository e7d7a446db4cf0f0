#pragma once

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace lumifold::scene {

/// kResourceExhausted: this machine, or what this process may use of it, has not enough memory "for ...".
absl::Status OutOfMemory(absl::string_view for_what);

/// Whether a status, whatever was put before its message, is one of OutOfMemory. Others of its code name a
/// limit that holds everywhere.
bool IsOutOfMemory(const absl::Status& status);

}  // namespace lumifold::scene
