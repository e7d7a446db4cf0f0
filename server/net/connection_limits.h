#pragma once

#include "absl/time/time.h"

namespace grpc {
class ServerBuilder;
}  // namespace grpc

namespace lumifold::server {

struct ConnectionLimits {
  /// Calls at a time over one connection; further ones wait at the client.
  int streams_per_connection = 256;
  /// Connections of one address. A farm behind a translated address has one for each worker.
  int connections_per_address = 4096;
  int connections = 16'384;
  /// From the connection to the end of the handshake, of TLS and HTTP/2.
  absl::Duration handshake = absl::Seconds(10);
  /// A connection without a call is closed after this time; clients connect again by themselves.
  absl::Duration idle_connection = absl::Minutes(10);
};

/// gRPC's side of the limits: sizes of messages, streams, and connections that are idle, dead or ping too
/// often.
void SetConnectionLimits(const ConnectionLimits& limits, grpc::ServerBuilder* builder);

/// A connection has the certificate that it was opened with. After a part of that certificate's life callers
/// are asked to open another, so that what was renewed is used before the old one expires.
void SetConnectionAge(absl::Duration certificate_lifetime, grpc::ServerBuilder* builder);

}  // namespace lumifold::server
