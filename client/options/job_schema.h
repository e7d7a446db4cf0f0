#pragma once

#include <string>
#include <vector>

#include "client/cli/command_help.h"

namespace lumifold::client {

/// JSON Schema (draft 2020-12) of job files: the options of `commands`, with their help.
std::string JobSchema(const std::vector<CommandHelp>& commands);

}  // namespace lumifold::client
