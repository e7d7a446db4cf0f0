#include "server/net/connection_limits.h"

#include <grpcpp/server_builder.h>

#include <algorithm>

#include "proto/rpc/limits.h"

namespace lumifold::server {
namespace {

/// Workers ping every rpc::kQuickKeepAlive, clients seldom; connections that ping faster than this are
/// closed.
constexpr int kMinPingIntervalMs = 1'000;
constexpr int kKeepAliveMs = 20'000;
constexpr int kKeepAliveTimeoutMs = 10'000;
constexpr int kConnectionsPerCertificate = 6;
constexpr absl::Duration kMaxConnectionAge = absl::Hours(1);

int Milliseconds(absl::Duration duration) { return static_cast<int>(absl::ToInt64Milliseconds(duration)); }

}  // namespace

void SetConnectionLimits(const ConnectionLimits& limits, grpc::ServerBuilder* builder) {
  builder->SetMaxReceiveMessageSize(rpc::kMaxMessageBytes);
  builder->SetMaxSendMessageSize(rpc::kMaxMessageBytes);
  builder->AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, limits.streams_per_connection);
  builder->AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, Milliseconds(limits.handshake));
  builder->AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, Milliseconds(limits.idle_connection));
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepAliveMs);
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepAliveTimeoutMs);
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder->AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kMinPingIntervalMs);
}

void SetConnectionAge(absl::Duration certificate_lifetime, grpc::ServerBuilder* builder) {
  const absl::Duration age = std::min(certificate_lifetime / kConnectionsPerCertificate, kMaxConnectionAge);
  builder->AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, Milliseconds(age));
}

}  // namespace lumifold::server
