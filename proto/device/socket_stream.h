#pragma once

#include <cstddef>

#include "absl/time/time.h"

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

 private:
  const int socket_;
  bool works_ = true;
};

}  // namespace lumifold::device
