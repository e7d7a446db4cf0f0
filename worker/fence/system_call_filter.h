#pragma once

#include "absl/status/status.h"

namespace lumifold::fence {

/// Refuses system calls that neither a renderer nor a filter needs, with a seccomp filter (seccomp(2)) for this thread
/// and those it will start: the calls fail with EPERM, and with ENOSYS where the C library then uses an older call.
/// `network` allows sockets of IPv4, IPv6, the local machine and the kernel's routing tables, but no listening ones.
/// Requires no_new_privs. Call it once: the filter knows the id of this process.
/// Errors: kUnimplemented where kernel or processor lack it; those of the system.
absl::Status FilterSystemCalls(bool network);

}  // namespace lumifold::fence
