#pragma once

#include "client/environment.h"

namespace lumifold::client {

/// The whole program `lumifold`: finds the subcommand, runs it and gives the process's exit code. argv[0] is
/// not looked at.
int RunClient(int argc, const char* const* argv, const Environment& environment);

}  // namespace lumifold::client
