#pragma once

#include <string>
#include <vector>

#include "client/cli/command_help.h"

namespace lumifold::client {

/// Scripts that complete the command line of `lumifold` in a shell: commands, options, and files where a
/// value is one.
std::string BashCompletion(const std::vector<CommandHelp>& commands);
std::string ZshCompletion(const std::vector<CommandHelp>& commands);
std::string FishCompletion(const std::vector<CommandHelp>& commands);

}  // namespace lumifold::client
