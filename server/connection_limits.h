#pragma once

#include "absl/time/time.h"
#include "server/limits.h"

namespace grpc {
class ServerBuilder;
}  // namespace grpc

namespace lumifold::server {

/// gRPC's side of the limits: sizes of messages, streams, and connections that are idle, dead or ping too often.
void SetConnectionLimits(const Limits& limits, grpc::ServerBuilder* builder);

/// A connection has the certificate that it was opened with. After a part of that certificate's life callers are asked to
/// open another, so that what was renewed is used before the old one expires.
void SetConnectionAge(absl::Duration certificate_lifetime, grpc::ServerBuilder* builder);

}  // namespace lumifold::server
