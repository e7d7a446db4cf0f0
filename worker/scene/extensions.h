#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "worker/scene/diagnostics.h"

namespace lumifold::scene {

/// Error: kInvalidArgument naming a required extension that the loader does not support. Notes each used
/// extension that is not supported, and what is lost.
absl::Status CheckExtensions(const std::vector<std::string>& used, const std::vector<std::string>& required,
                             Diagnostics* diagnostics);

}  // namespace lumifold::scene
