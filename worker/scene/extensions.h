#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "worker/scene/diagnostics.h"

namespace lumifold::scene {

/// Refuses a required extension that this loader does not know, naming it (kInvalidArgument), and notes each
/// used one with what is lost.
absl::Status CheckExtensions(const std::vector<std::string>& used, const std::vector<std::string>& required,
                             Diagnostics* diagnostics);

}  // namespace lumifold::scene
