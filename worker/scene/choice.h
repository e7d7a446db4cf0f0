#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace lumifold::scene {

/// The place among `names` of the one that a user asks for: by its name, or by its number from 0.
/// Error: kNotFound, naming the kind of thing ("camera") and those that exist.
absl::StatusOr<int> Choose(const char* kind, const std::vector<std::string>& names,
                           const std::string& wanted);

}  // namespace lumifold::scene
