#pragma once

#include <sys/types.h>

#include <cstddef>

#include "absl/functional/function_ref.h"
#include "absl/time/time.h"
#include "filter/image/plane.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::device {

/// Bytes over a connected socket that another object owns. After a call that has failed all others fail.
/// Threads: one at a time.
class SocketStream {
 public:
  /// Calls fail where the other end does nothing for `patience`.
  explicit SocketStream(int socket, absl::Duration patience = absl::InfiniteDuration());

  bool Write(const void* from, size_t bytes);
  /// False also where the other end is closed before.
  bool Read(void* to, size_t bytes);
  /// The rows of a plane, many at a time.
  bool WriteRows(ConstFloatView plane);
  bool ReadRows(FloatView plane);

 private:
  /// Calls move(done, left), which moves some bytes, until all have moved.
  bool MoveAll(size_t bytes, absl::FunctionRef<ssize_t(size_t done, size_t left)> move);

  const int socket_;
  bool works_ = true;
};

/// Sends a descriptor over a socket, at whose other end a process gets one of its own. False if that failed.
bool SendDescriptor(int socket, int descriptor);
/// The next descriptor from there; not valid once the other end is closed.
rpc::FileHandle ReceiveDescriptor(int socket);

}  // namespace lumifold::device
