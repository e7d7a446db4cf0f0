#pragma once

#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace lumifold::rpc {

/// The gRPC status with the same code and message, both as retry::ForCaller. Both enumerations have the same
/// numbers.
grpc::Status GrpcFromStatus(const absl::Status& status);

/// The inverse of GrpcFromStatus; unknown codes become kUnknown.
absl::Status StatusFromGrpc(const grpc::Status& status);

}  // namespace lumifold::rpc
