#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

struct ListenerOptions {
  /// HOST:PORT; port 0 for a free port. A host with several addresses is listened on at all of them.
  std::string address = {};
  /// Connections begin with the handshake of TLS, or else with the preface of HTTP/2.
  bool expects_tls = false;
  /// Of one IPv4 address, or of one IPv6 network of 64 bits; and of all.
  int connections_per_address = 4096;
  int connections = 16'384;
  /// Time from the connection to its first bytes.
  absl::Duration first_bytes = absl::Seconds(10);
  /// Connections of an address that are of no use, because the listener closes them or they end before a
  /// call: so many a second, and at once. Then the address is shut out.
  double refusals_per_second = 10;
  double refusal_burst = 100;
  /// How long an address that was shut out opens no new connection.
  absl::Duration shut_out = absl::Seconds(10);
  /// Monotonic.
  std::function<absl::Time()> now = nullptr;
  std::shared_ptr<spdlog::logger> log = nullptr;
};

/// Accepts connections, and hands on those that begin as they should and are not too many of one address.
/// gRPC's own listener does not count by address. The others are closed and logged, at most ten lines a
/// second; an address with too many connections of no use is shut out for a while: the kernel drops its
/// packets, where it can.
/// Threads: has one of its own; safe.
class Listener {
 public:
  /// Listens. Connections wait until Start.
  /// Errors: kUnavailable naming the address.
  static absl::StatusOr<std::unique_ptr<Listener>> Open(const ListenerOptions& options);
  /// Calls Stop.
  virtual ~Listener() = default;

  virtual int port() const = 0;
  /// `take` becomes the owner of a connected socket, which does not block; it is called on the listener's
  /// thread.
  virtual void Start(std::function<void(int socket)> take) = 0;
  /// Closes the connection of this name, as in grpc::ServerContext::peer, and for ListenerOptions::shut_out
  /// all new ones of its address, unread. The address's other connections stay: they may be those of workers.
  /// No effect on names that are not of IP. Returns at once.
  virtual void ShutOut(absl::string_view peer) = 0;
  /// A call was admitted on the connection of this name, as above. Those that end before one are refused
  /// connections, too.
  virtual void NoteCall(absl::string_view peer) = 0;
  /// Closes the door; connections that were handed on stay. After it returns `take` is not called again.
  virtual void Stop() = 0;
};

}  // namespace lumifold::server
