#pragma once

#include "client/cli/command_line.h"
#include "client/pictures/display_file.h"

namespace lumifold::client {

/// Adds --view, --exposure and --quality: how light becomes values of a .png or .jpg.
void AddDisplayOptions(CommandLine& command_line, pictures::DisplayOptions* display);

}  // namespace lumifold::client
