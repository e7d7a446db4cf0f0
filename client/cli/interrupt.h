#pragma once

namespace lumifold::client {

/// Makes the first Ctrl-C (SIGINT) or SIGTERM set Interrupted(); a second one ends the program at once. Call
/// it once, from main.
void CatchInterrupts();

/// True after the first SIGINT or SIGTERM.
/// Threads: any.
bool Interrupted();

}  // namespace lumifold::client
