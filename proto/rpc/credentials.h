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

/// How connections are protected. Plain text is all there is so far; certificates and tokens will be fields
/// here.
struct Security {
  /// Allow plain text beyond this machine.
  bool insecure = false;
};

/// True for "127.x.y.z:port", "localhost:port", "[::1]:port" and "unix:path": addresses only this machine can
/// reach.
bool IsLoopback(const std::string& address);

/// Checks that `address` is HOST:PORT and that listening there is allowed: off loopback only with
/// security.insecure.
/// Errors: kInvalidArgument for an address that is none; kFailedPrecondition where it is not allowed. Both
/// name the address.
absl::Status CheckListenAddress(const std::string& address, const Security& security);

/// What a server listens with.
std::shared_ptr<grpc::ServerCredentials> MakeServerCredentials(const Security& security);

/// What a client or worker connects with.
std::shared_ptr<grpc::ChannelCredentials> MakeChannelCredentials(const Security& security);

/// A channel to HOST:PORT with our limits on message size and keep-alive pings that notice a dead peer within
/// half a minute. It connects when it is first used.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address, const Security& security);

}  // namespace lumifold::rpc
