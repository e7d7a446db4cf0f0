#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "proto/rpc/credentials.h"

namespace lumifold::server {

struct HealthCheckOptions {
  std::string address;  // HOST:PORT of a coordinator
  rpc::Security security = {};
  /// Also content with a coordinator that answers but does not serve, because its storage cannot be written
  /// or it is stopping.
  bool answers_only = false;
  absl::Duration timeout = absl::Seconds(5);
};

/// Asks grpc.health.v1.Health whether a coordinator serves, over the connection that clients use.
/// Errors: kUnavailable if it does not answer or does not serve, with the reason.
absl::Status CheckHealth(const HealthCheckOptions& options);

}  // namespace lumifold::server
