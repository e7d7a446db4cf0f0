#pragma once

#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace lumifold::rpc {

/// The same code and message for gRPC. Both enumerations number the codes alike.
grpc::Status GrpcFromStatus(const absl::Status& status);

/// The inverse of GrpcFromStatus; a code this build does not know becomes kUnknown.
absl::Status StatusFromGrpc(const grpc::Status& status);

}  // namespace lumifold::rpc
