#pragma once

#include <memory>
#include <string>

#include "absl/status/status.h"

namespace grpc {
class Channel;
class ChannelCredentials;
class ServerCredentials;
}  // namespace grpc

namespace lumifold::rpc {

/// Security of connections. Only plain text is supported so far.
struct Security {
  /// Allow plain text on addresses that other machines can reach.
  bool insecure = false;
};

/// True for "127.x.y.z:port", "localhost:port", "[::1]:port" and "unix:path": addresses that only this
/// machine can reach.
bool IsLoopback(const std::string& address);

/// Checks that `address` is HOST:PORT and that listening there is allowed: off loopback only with
/// security.insecure.
/// Errors: kInvalidArgument for a malformed address; kFailedPrecondition if it is not allowed. Both name the
/// address.
absl::Status CheckListenAddress(const std::string& address, const Security& security);

/// Credentials of a server.
std::shared_ptr<grpc::ServerCredentials> MakeServerCredentials(const Security& security);

/// Credentials of a client or worker.
std::shared_ptr<grpc::ChannelCredentials> MakeChannelCredentials(const Security& security);

/// A channel to HOST:PORT with our limit of message size and keep-alive pings that detect a dead peer within
/// 30 s. It connects on first use, and reconnects by itself with the pauses of ReconnectSchedule.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address, const Security& security);

}  // namespace lumifold::rpc
