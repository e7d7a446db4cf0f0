#pragma once

namespace lumifold::client {

/// From here on the first Ctrl-C (SIGINT) or SIGTERM only asks the program to stop; a second one ends it at
/// once. Call it once, from main.
void CatchInterrupts();

/// True once the program has been asked to stop. Threads: any.
bool Interrupted();

}  // namespace lumifold::client
