#pragma once

#include "client/cli/environment.h"

namespace lumifold::client {

/// The main function of the program `lumifold`: finds and runs the subcommand and returns the exit code.
/// argv[0] is ignored.
int RunClient(int argc, const char* const* argv, const Environment& environment);

}  // namespace lumifold::client
