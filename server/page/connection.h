#pragma once

#include <httplib.h>
#include <openssl/ssl.h>

#include <array>
#include <memory>
#include <string>

#include "absl/time/time.h"

namespace lumifold::page {

struct FreeSsl {
  void operator()(SSL* ssl) const { SSL_free(ssl); }
};

/// One connection of a browser, in plain text or over TLS. Unlike httplib's own, it has deadlines for a whole request and for each
/// write, so that nobody holds a thread by sending or reading a byte now and then.
class Connection final : public httplib::Stream {
 public:
  /// Does not own the socket. `ssl`: null in plain text.
  Connection(socket_t socket, SSL* ssl);

  /// The handshake of TLS. False if it fails or takes until the deadline.
  bool Accept();
  /// By when all that follows must be read.
  void SetReadDeadline(absl::Time deadline) { read_deadline_ = deadline; }
  /// Waits until there is something to read. False at `deadline` and where the other side has closed.
  bool WaitForRequest(absl::Time deadline);

  bool is_readable() const override;
  bool is_writable() const override;
  ssize_t read(char* bytes, size_t size) override;
  ssize_t write(const char* bytes, size_t size) override;
  void get_remote_ip_and_port(std::string& ip, int& port) const override;
  void get_local_ip_and_port(std::string& ip, int& port) const override;
  socket_t socket() const override { return socket_; }

 private:
  /// Bytes, 0 at the end, -1 for errors and at the deadline.
  ssize_t ReadSome(char* bytes, size_t size, absl::Time deadline);
  ssize_t WriteSome(const char* bytes, size_t size, absl::Time deadline);
  /// Whether the socket is ready for what a call of OpenSSL wants.
  bool WaitAfter(int result, absl::Time deadline) const;

  const socket_t socket_;
  const std::unique_ptr<SSL, FreeSsl> ssl_;
  absl::Time read_deadline_ = absl::InfinitePast();
  std::array<char, 4096> buffer_ = {};
  size_t begin_ = 0;  // of what is in the buffer
  size_t end_ = 0;
};

}  // namespace lumifold::page
