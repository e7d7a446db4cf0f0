#include "server/page/connection.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "proto/rpc/monotonic.h"

namespace lumifold::page {
namespace {

/// For the other side to take what is written.
constexpr absl::Duration kWriteTime = absl::Seconds(10);

bool WaitFor(socket_t socket, short events, absl::Time deadline) {
  while (true) {
    const absl::Duration left = std::max(deadline - rpc::MonotonicNow(), absl::ZeroDuration());
    pollfd wanted = {.fd = socket, .events = events, .revents = 0};
    const int ready = poll(
        &wanted, 1, static_cast<int>(absl::ToInt64Milliseconds(absl::Ceil(left, absl::Milliseconds(1)))));
    if (ready > 0) return (wanted.revents & events) != 0;
    if (ready == 0 || errno != EINTR) return false;
  }
}

void NameOf(const sockaddr_storage& address, std::string* ip, int* port) {
  std::array<char, INET6_ADDRSTRLEN> text = {};
  if (address.ss_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(address);
    inet_ntop(AF_INET, &v4.sin_addr, text.data(), text.size());
    *port = ntohs(v4.sin_port);
  } else if (address.ss_family == AF_INET6) {
    const auto& v6 = reinterpret_cast<const sockaddr_in6&>(address);
    inet_ntop(AF_INET6, &v6.sin6_addr, text.data(), text.size());
    *port = ntohs(v6.sin6_port);
  }
  *ip = text.data();
}

}  // namespace

Connection::Connection(socket_t socket, SSL* ssl) : socket_(socket), ssl_(ssl) {
  if (ssl_ != nullptr) SSL_set_fd(ssl_.get(), socket_);
}

bool Connection::WaitAfter(int result, absl::Time deadline) const {
  const int error = SSL_get_error(ssl_.get(), result);
  if (error == SSL_ERROR_WANT_READ) return WaitFor(socket_, POLLIN, deadline);
  if (error == SSL_ERROR_WANT_WRITE) return WaitFor(socket_, POLLOUT, deadline);
  return false;
}

bool Connection::Accept() {
  if (ssl_ == nullptr) return true;
  while (true) {
    const int result = SSL_accept(ssl_.get());
    if (result == 1) return true;
    if (!WaitAfter(result, read_deadline_)) return false;
  }
}

bool Connection::WaitForRequest(absl::Time deadline) {
  const bool has_bytes = begin_ < end_ || (ssl_ != nullptr && SSL_pending(ssl_.get()) > 0);
  return has_bytes || WaitFor(socket_, POLLIN, deadline);
}

ssize_t Connection::ReadSome(char* bytes, size_t size, absl::Time deadline) {
  const int most = static_cast<int>(std::min(size, size_t{1} << 20));
  while (true) {
    if (ssl_ != nullptr) {
      const int got = SSL_read(ssl_.get(), bytes, most);
      if (got > 0) return got;
      if (!WaitAfter(got, deadline)) return -1;
    } else {
      const ssize_t got = recv(socket_, bytes, size, 0);
      if (got >= 0) return got;
      if (errno == EINTR) continue;
      if (errno != EAGAIN || !WaitFor(socket_, POLLIN, deadline)) return -1;
    }
    if (rpc::MonotonicNow() >= deadline) return -1;
  }
}

ssize_t Connection::WriteSome(const char* bytes, size_t size, absl::Time deadline) {
  const int most = static_cast<int>(std::min(size, size_t{1} << 20));
  while (true) {
    if (ssl_ != nullptr) {
      const int put = SSL_write(ssl_.get(), bytes, most);
      if (put > 0) return put;
      if (!WaitAfter(put, deadline)) return -1;
    } else {
      const ssize_t put = send(socket_, bytes, size, MSG_NOSIGNAL);
      if (put >= 0) return put;
      if (errno == EINTR) continue;
      if (errno != EAGAIN || !WaitFor(socket_, POLLOUT, deadline)) return -1;
    }
  }
}

bool Connection::is_readable() const { return begin_ < end_ || WaitFor(socket_, POLLIN, read_deadline_); }

bool Connection::is_writable() const { return WaitFor(socket_, POLLOUT, rpc::MonotonicNow() + kWriteTime); }

ssize_t Connection::read(char* bytes, size_t size) {
  if (begin_ == end_) {
    const ssize_t got = ReadSome(buffer_.data(), buffer_.size(), read_deadline_);
    if (got <= 0) return got;
    begin_ = 0;
    end_ = static_cast<size_t>(got);
  }
  const size_t taken = std::min(size, end_ - begin_);
  std::memcpy(bytes, buffer_.data() + begin_, taken);
  begin_ += taken;
  return static_cast<ssize_t>(taken);
}

ssize_t Connection::write(const char* bytes, size_t size) {
  const absl::Time deadline = rpc::MonotonicNow() + kWriteTime;
  size_t done = 0;
  while (done < size) {
    const ssize_t put = WriteSome(bytes + done, size - done, deadline);
    if (put <= 0) return -1;
    done += static_cast<size_t>(put);
  }
  return static_cast<ssize_t>(size);
}

void Connection::get_remote_ip_and_port(std::string& ip, int& port) const {
  sockaddr_storage address = {};
  socklen_t size = sizeof(address);
  if (getpeername(socket_, reinterpret_cast<sockaddr*>(&address), &size) == 0) NameOf(address, &ip, &port);
}

void Connection::get_local_ip_and_port(std::string& ip, int& port) const {
  sockaddr_storage address = {};
  socklen_t size = sizeof(address);
  if (getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size) == 0) NameOf(address, &ip, &port);
}

}  // namespace lumifold::page
