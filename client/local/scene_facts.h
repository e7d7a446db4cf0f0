#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "client/cli/local_work.h"

namespace lumifold::local {

/// Reads the scene at `path` with all its files and says what is in it. Errors: those of scene::LoadGltfFile.
absl::StatusOr<client::SceneFacts> ReadSceneFacts(const std::string& path);

}  // namespace lumifold::local
