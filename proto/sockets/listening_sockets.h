#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::sockets {

/// Sockets that listen; none blocks, and no child process inherits them.
struct ListeningSockets {
  std::vector<rpc::FileHandle> sockets;  // at least one
  int port = 0;                          // of all
};

/// Listens at each address of this machine that HOST:PORT names; "[::]" takes IPv4 as well. With port 0 the
/// first address gets a free port, and the others the same one.
/// Errors: kUnavailable naming the address.
absl::StatusOr<ListeningSockets> ListenAt(const std::string& address);

}  // namespace lumifold::sockets
