#pragma once

#include "absl/status/status.h"

namespace lumifold::sandbox {

/// What a process may do with sockets. No process may make one listen.
struct SocketRules {
  /// Sockets of IPv4, IPv6, the local machine and the kernel's routing tables.
  bool network = false;
  /// Connections to sockets that listen already.
  bool accepts = false;
};

/// Refuses system calls that neither a renderer nor a filter needs, with a seccomp filter (seccomp(2)) for
/// this thread and those it will start: the calls fail with EPERM, and with ENOSYS where the C library then
/// uses an older call. Requires no_new_privs. Call it once: the filter knows the id of this process.
/// Errors: kUnimplemented where kernel or processor lack it; those of the system.
absl::Status FilterSystemCalls(const SocketRules& sockets);

}  // namespace lumifold::sandbox
