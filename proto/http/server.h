#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/http/message.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::http {

/// What one connection may cost. A connection that exceeds a time is closed without an answer.
struct Limits {
  /// Of the request line with all headers: 431.
  size_t header_bytes = 16 << 10;
  /// Of a request's body: 413.
  size_t body_bytes = 64 << 10;
  /// For the handshake of TLS.
  absl::Duration handshake_time = absl::Seconds(10);
  /// From the first byte of a request to its last.
  absl::Duration request_time = absl::Seconds(10);
  /// Until the first byte of a request.
  absl::Duration idle_time = absl::Seconds(30);
  /// For the caller to take 64 KiB of an answer, or what is left of it.
  absl::Duration write_time = absl::Seconds(10);
  /// At a time; more wait in the kernel. While some wait, the server closes connections that for `patience`
  /// have not completed a request: those that are idle, that send slowly, that do not end after an answer.
  size_t connections = 256;
  absl::Duration patience = absl::Seconds(1);
  /// Handlers at a time; more wait. Threads start when they are needed.
  size_t threads = 256;
};

struct ServerOptions {
  /// Sockets that listen, see sockets::ListenAt. Must outlive the server; connections wait there while there
  /// is none.
  const std::vector<rpc::FileHandle>* listening = nullptr;
  /// PEM file with key and certificates, read again when it changes; empty: plain text.
  std::string certificate_path = {};
  Limits limits = {};
  /// Of all answers, those of the server itself included.
  Headers headers = {};
  /// Called by several threads. It may block. What it throws is answered with 500.
  std::function<Response(const Request&)> handler;
};

/// A server of HTTP/1.0 and 1.1, in plain text or over TLS 1.2 and later, that bounds what each caller costs:
/// one thread does all input and output, so that no thread waits for a caller.
///
/// It refuses what two readers could understand differently: several lengths or hosts, and bodies without a
/// Content-Length (chunked requests get 411).
/// Threads: safe; it has its own. Inside a worker's sandbox it needs epoll, eventfd, timerfd and accept4.
class Server {
 public:
  /// Errors: kUnavailable where the certificate cannot be read, or no descriptor or thread is left.
  static absl::StatusOr<std::unique_ptr<Server>> Start(ServerOptions options);
  virtual ~Server() = default;

  /// Ends streams and idle connections, waits for the handlers that run, and gives their answers a second to
  /// be sent. Later calls have no effect.
  virtual void Stop() = 0;
};

}  // namespace lumifold::http
