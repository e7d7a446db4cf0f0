#include "proto/rpc/credentials.h"

#include <arpa/inet.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/security/server_credentials.h>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/reconnect_schedule.h"

namespace lumifold::rpc {
namespace {

constexpr int kKeepAliveMs = 20'000;
constexpr int kKeepAliveTimeoutMs = 10'000;
// Time for one attempt to connect, handshake included. gRPC's default of 20 s delays the next attempt where
// packets vanish.
constexpr absl::Duration kConnectTimeout = absl::Seconds(5);

int Milliseconds(absl::Duration duration) { return static_cast<int>(absl::ToInt64Milliseconds(duration)); }

// HOST:PORT with a port of 0 to 65535; an IPv6 host is in brackets.
bool IsHostAndPort(const std::string& address) {
  const size_t colon = address.rfind(':');
  if (colon == std::string_view::npos || colon == 0) return false;
  const std::string host = address.substr(0, colon);
  const bool bracketed = host.front() == '[' && host.back() == ']';
  if (!bracketed && absl::StrContains(host, ":")) return false;
  int port = -1;
  return absl::SimpleAtoi(address.substr(colon + 1), &port) && port >= 0 && port <= 65535;
}

}  // namespace

bool IsLoopback(const std::string& address) {
  if (absl::StartsWith(address, "unix:")) return true;
  const std::string host = address.substr(0, address.rfind(':'));
  in_addr ip4 = {};
  // Only a literal address: "127.example.org" is a name that may resolve to any address.
  const bool is_ip4_loopback = inet_pton(AF_INET, host.c_str(), &ip4) == 1 && absl::StartsWith(host, "127.");
  return is_ip4_loopback || host == "localhost" || host == "[::1]";
}

absl::Status CheckListenAddress(const std::string& address, const Security& security) {
  if (!absl::StartsWith(address, "unix:") && !IsHostAndPort(address)) {
    return absl::InvalidArgumentError(absl::StrCat("'", address, "' is not HOST:PORT"));
  }
  if (!IsLoopback(address) && !security.insecure) {
    return absl::FailedPreconditionError(absl::StrCat(
        "listening on ", address,
        " would accept connections of other machines without encryption; allow it with --insecure"));
  }
  return absl::OkStatus();
}

std::shared_ptr<grpc::ServerCredentials> MakeServerCredentials(const Security&) {
  return grpc::InsecureServerCredentials();
}

std::shared_ptr<grpc::ChannelCredentials> MakeChannelCredentials(const Security&) {
  return grpc::InsecureChannelCredentials();
}

std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address, const Security& security) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  arguments.SetMaxSendMessageSize(kMaxMessageBytes);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepAliveMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepAliveTimeoutMs);
  // gRPC's default lets the pauses between attempts grow to two minutes. It adds jitter of 20 %.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, Milliseconds(kFirstReconnectPause));
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, Milliseconds(kConnectTimeout));
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, Milliseconds(kLongestReconnectPause));
  // Each caller gets its own channel: two workers in one test process must not share a connection.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(address, MakeChannelCredentials(security), arguments);
}

}  // namespace lumifold::rpc
