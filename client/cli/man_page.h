#pragma once

#include <string>
#include <vector>

#include "client/cli/command_help.h"

namespace lumifold::client {

/// The page of a command for man, in section 1: lumifold-COMMAND.
std::string ManPage(const CommandHelp& command);
/// The page lumifold, which lists the commands.
std::string ManPage(const std::vector<CommandHelp>& commands);

}  // namespace lumifold::client
