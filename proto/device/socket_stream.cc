#include "proto/device/socket_stream.h"

#include <sys/socket.h>
#include <sys/time.h>

#include <cerrno>

namespace lumifold::device {

SocketStream::SocketStream(int socket, absl::Duration patience) : socket_(socket) {
  if (patience == absl::InfiniteDuration()) return;
  const timeval limit = absl::ToTimeval(patience);
  for (const int option : {SO_RCVTIMEO, SO_SNDTIMEO})
    works_ = works_ && setsockopt(socket_, SOL_SOCKET, option, &limit, sizeof(limit)) == 0;
}

bool SocketStream::Write(const void* from, size_t bytes) {
  const auto* at = static_cast<const char*>(from);
  while (works_ && bytes > 0) {
    const ssize_t count = send(socket_, at, bytes, MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    works_ = count > 0;
    if (!works_) break;
    at += count;
    bytes -= static_cast<size_t>(count);
  }
  return works_;
}

bool SocketStream::Read(void* to, size_t bytes) {
  auto* at = static_cast<char*>(to);
  while (works_ && bytes > 0) {
    const ssize_t count = recv(socket_, at, bytes, MSG_WAITALL);
    if (count < 0 && errno == EINTR) continue;
    works_ = count > 0;
    if (!works_) break;
    at += count;
    bytes -= static_cast<size_t>(count);
  }
  return works_;
}

}  // namespace lumifold::device
