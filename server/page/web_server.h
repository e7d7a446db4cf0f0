#pragma once

#include <httplib.h>
#include <openssl/ssl.h>

#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "absl/status/status.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::page {

struct WebServerOptions {
  /// HOST:PORT; port 0: a free port.
  std::string address;
  /// PEM file with key and certificates, read again for each connection; empty: plain text.
  std::string certificate_path;
  /// Connections at a time, each of which has a thread; others are closed.
  int connections = 256;
};

struct FreeSslContext {
  void operator()(SSL_CTX* context) const { SSL_CTX_free(context); }
};

/// httplib's server with bounds on its connections and their time, see Connection.
/// Threads: handlers are called from many; those that set them must be called before Start.
class WebServer final : private httplib::Server {
 public:
  explicit WebServer(WebServerOptions options) : options_(std::move(options)) {}
  ~WebServer() override { Stop(); }

  using httplib::Server::Get;
  using httplib::Server::Post;
  using httplib::Server::set_default_headers;
  using httplib::Server::set_exception_handler;
  using httplib::Server::set_pre_routing_handler;

  /// Errors: kInvalidArgument for the address; kUnavailable where it cannot listen or read its certificate.
  absl::Status Start();
  /// Waits for the handlers that run.
  void Stop();
  int port() const { return port_; }
  bool uses_tls() const { return !options_.certificate_path.empty(); }

 private:
  class Threads;
  bool process_and_close_socket(socket_t socket) override;
  bool Serve(socket_t socket);
  /// Null where the certificate cannot be used.
  std::unique_ptr<SSL_CTX, FreeSslContext> MakeContext() const;

  const WebServerOptions options_;
  int port_ = 0;
  rpc::MonotonicEvent stop_;
  std::thread thread_;
};

}  // namespace lumifold::page
