#pragma once

namespace lumifold::threads {

/// Ends the process with exit code `code`. Streams of the standard library are flushed, static objects are
/// not destroyed: a library's threads may outlive main(), as gRPC's do that still work on a connection of a
/// channel that is gone, and would use what is destroyed.
[[noreturn]] void EndProcess(int code);

}  // namespace lumifold::threads
