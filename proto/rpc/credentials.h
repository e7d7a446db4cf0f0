#pragma once

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace grpc {
class AuthMetadataProcessor;
class Channel;
class ChannelCredentials;
class ServerCredentials;
}  // namespace grpc

namespace lumifold::rpc {

/// Security of connections: plain text, or TLS 1.2 or later where `ca_path` is set.
struct Security {
  /// Allow plain text on addresses that other machines can reach.
  bool insecure = false;
  /// PEM file of the authority that signs the other side's certificate. Read again when it changes.
  std::string ca_path;
  /// PEM file of this side: its private key, its certificate and those above it. In one file, so that a new
  /// one replaces both at once; read again when it changes. A server has one; a client may.
  std::string certificate_path;
  /// Sent with each call of a client, over TLS only; empty: none.
  std::string token;

  bool uses_tls() const { return !ca_path.empty(); }
};

/// True for "127.x.y.z:port", "localhost:port", "[::1]:port" and "unix:path": addresses that only this
/// machine can reach.
bool IsLoopback(const std::string& address);

/// HOST and PORT of an address. An IPv6 host is in brackets in the address, without them in the result.
struct HostAndPort {
  std::string host;
  int port = 0;
};
/// Errors: kInvalidArgument naming the address.
absl::Status ParseHostAndPort(const std::string& address, HostAndPort* result);

/// Checks that `address` is HOST:PORT and that listening there is allowed: off loopback only with TLS or
/// security.insecure.
/// Errors: kInvalidArgument for a malformed address; kFailedPrecondition if it is not allowed. Both name the
/// address.
absl::Status CheckListenAddress(const std::string& address, const Security& security);

/// The same for a client of `address`, so that nothing goes to another machine in plain text without being
/// asked for.
absl::Status CheckServerAddress(const std::string& address, const Security& security);

/// Credentials of a server. With TLS, clients are asked for a certificate, which must be one of the
/// authority, and may come without one. `processor` sees each call's metadata before any of its messages is
/// parsed; null: none. It is not used in plain text.
std::shared_ptr<grpc::ServerCredentials> MakeServerCredentials(
    const Security& security, std::shared_ptr<grpc::AuthMetadataProcessor> processor = nullptr);

/// Credentials of a client or worker. With TLS the server's certificate must be one of the authority and have
/// the name that the client connects to.
std::shared_ptr<grpc::ChannelCredentials> MakeChannelCredentials(const Security& security);

/// How soon a peer that is silent is taken for dead: after `time` without a byte from it a ping is sent,
/// which it must answer within `timeout`. Servers allow a `time` of 1 s and more.
struct KeepAlive {
  absl::Duration time = absl::Seconds(20);
  absl::Duration timeout = absl::Seconds(10);
};
/// For callers that have another peer to go to: 5 s together. Half of it would take a busy or distant
/// coordinator for dead.
inline constexpr KeepAlive kQuickKeepAlive = {.time = absl::Seconds(2), .timeout = absl::Seconds(3)};

/// A channel to HOST:PORT with our limit of message size. It connects on first use, and reconnects by itself
/// with the pauses kReconnectPauses.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address, const Security& security,
                                           const KeepAlive& keep_alive = {});

}  // namespace lumifold::rpc
