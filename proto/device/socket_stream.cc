#include "proto/device/socket_stream.h"

#include <sys/socket.h>
#include <sys/time.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace lumifold::device {
namespace {

/// One byte, and a descriptor beside it.
struct DescriptorMessage {
  char byte = 0;
  iovec bytes = {&byte, 1};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> space = {};
  msghdr header = {};

  DescriptorMessage() {
    header.msg_iov = &bytes;
    header.msg_iovlen = 1;
    header.msg_control = space.data();
    header.msg_controllen = space.size();
  }
  DescriptorMessage(const DescriptorMessage&) = delete;
  DescriptorMessage& operator=(const DescriptorMessage&) = delete;
};

}  // namespace

SocketStream::SocketStream(int socket, absl::Duration patience) : socket_(socket) {
  if (patience == absl::InfiniteDuration()) return;
  const timeval limit = absl::ToTimeval(patience);
  for (const int option : {SO_RCVTIMEO, SO_SNDTIMEO})
    works_ = works_ && setsockopt(socket_, SOL_SOCKET, option, &limit, sizeof(limit)) == 0;
}

bool SocketStream::MoveAll(size_t bytes, absl::FunctionRef<ssize_t(size_t done, size_t left)> move) {
  size_t done = 0;
  while (works_ && done < bytes) {
    const ssize_t count = move(done, bytes - done);
    if (count < 0 && errno == EINTR) continue;
    works_ = count > 0;
    if (works_) done += static_cast<size_t>(count);
  }
  return works_;
}

bool SocketStream::Write(const void* from, size_t bytes) {
  return MoveAll(bytes, [&](size_t done, size_t left) {
    return send(socket_, static_cast<const char*>(from) + done, left, MSG_NOSIGNAL);
  });
}

bool SocketStream::Read(void* to, size_t bytes) {
  return MoveAll(bytes, [&](size_t done, size_t left) {
    return recv(socket_, static_cast<char*>(to) + done, left, MSG_WAITALL);
  });
}

bool SendDescriptor(int socket, int descriptor) {
  DescriptorMessage message;
  cmsghdr* const part = CMSG_FIRSTHDR(&message.header);
  part->cmsg_level = SOL_SOCKET;
  part->cmsg_type = SCM_RIGHTS;
  part->cmsg_len = CMSG_LEN(sizeof(int));
  std::memcpy(CMSG_DATA(part), &descriptor, sizeof(int));
  return sendmsg(socket, &message.header, MSG_NOSIGNAL) == 1;
}

rpc::FileHandle ReceiveDescriptor(int socket) {
  DescriptorMessage message;
  ssize_t count = 0;
  do count = recvmsg(socket, &message.header, MSG_CMSG_CLOEXEC);
  while (count < 0 && errno == EINTR);
  const cmsghdr* const part = CMSG_FIRSTHDR(&message.header);
  if (count != 1 || part == nullptr || part->cmsg_type != SCM_RIGHTS) return {};
  int descriptor = -1;
  std::memcpy(&descriptor, CMSG_DATA(part), sizeof(int));
  return rpc::FileHandle(descriptor);
}

}  // namespace lumifold::device
