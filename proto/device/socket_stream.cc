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

size_t BytesOf(ConstFloatView plane) {
  return static_cast<size_t>(plane.width()) * static_cast<size_t>(plane.height()) * sizeof(float);
}

/// Rows of a plane, without what is between them, from a byte on.
struct RowsMessage {
  std::array<iovec, 64> rows = {};  // a call for each would take longer than the copy
  msghdr header = {};

  RowsMessage(ConstFloatView plane, size_t first_byte) {
    const size_t row_bytes = static_cast<size_t>(plane.width()) * sizeof(float);
    size_t count = 0, begin = first_byte % row_bytes;
    for (auto y = static_cast<int>(first_byte / row_bytes); y < plane.height() && count < rows.size(); ++y) {
      // A message has no other type for what is only read.
      char* const row = reinterpret_cast<char*>(const_cast<float*>(plane.Row(y)));
      rows[count++] = {row + begin, row_bytes - begin};
      begin = 0;
    }
    header.msg_iov = rows.data();
    header.msg_iovlen = count;
  }
  RowsMessage(const RowsMessage&) = delete;
  RowsMessage& operator=(const RowsMessage&) = delete;
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

bool SocketStream::WriteRows(ConstFloatView plane) {
  return MoveAll(BytesOf(plane), [&](size_t done, size_t) {
    RowsMessage message(plane, done);
    return sendmsg(socket_, &message.header, MSG_NOSIGNAL);
  });
}

bool SocketStream::ReadRows(FloatView plane) {
  return MoveAll(BytesOf(plane), [&](size_t done, size_t) {
    RowsMessage message(plane, done);
    return recvmsg(socket_, &message.header, MSG_WAITALL);
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
