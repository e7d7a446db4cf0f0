#pragma once

#include <openssl/ssl.h>

#include <functional>
#include <memory>
#include <string>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "proto/http/server.h"
#include "proto/rpc/byte_stream.h"
#include "proto/sockets/listening_sockets.h"
#include "tests/support/temp_folder.h"

namespace lumifold::http {

/// A caller that sends what bytes it likes.
class RawCaller {
 public:
  /// A socket that is not connected.
  RawCaller();
  /// Connects to 127.0.0.1.
  explicit RawCaller(int port) : RawCaller() { Connect(port); }
  RawCaller(RawCaller&& other) = default;

  void Connect(int port);
  /// The handshake of TLS; `highest`: version. Whether it succeeded.
  bool StartTls(int highest = TLS1_3_VERSION);
  /// Whether all could be sent: the server may have closed.
  bool Send(absl::string_view bytes);
  /// Says that nothing more comes.
  void EndSending();
  /// What comes until `end` has been seen, the connection ends, or nothing comes for 20 s ("timeout" follows
  /// then).
  std::string ReadTo(absl::string_view end);
  std::string ReadAll() { return ReadTo("no answer has this"); }
  /// SHA-256 of the server's certificate.
  std::string Certificate() const;
  int socket() const { return socket_.get(); }

 private:
  struct FreeSsl {
    void operator()(SSL* ssl) const { SSL_free(ssl); }
  };
  rpc::FileHandle socket_;
  std::unique_ptr<SSL, FreeSsl> tls_;
};

/// A server at a free port of 127.0.0.1.
struct TestServer {
  /// `options` without what listens.
  explicit TestServer(ServerOptions options);
  RawCaller Caller() const;
  /// The answer to a request on a connection of its own.
  std::string Ask(absl::string_view request) const;

  bool uses_tls;
  sockets::ListeningSockets listening;
  std::unique_ptr<Server> server;
};

inline constexpr char kGet[] = "GET / HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n";

/// Writes a new key and certificate for 127.0.0.1, and returns its path.
std::string WriteCertificate(const TempFolder& folder);

}  // namespace lumifold::http
