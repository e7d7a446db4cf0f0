#include "proto/rpc/status_codec.h"

#include <string>

#include "proto/retry/storage_away.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"

namespace lumifold::rpc {
namespace {

constexpr int kLastCode = static_cast<int>(grpc::StatusCode::UNAUTHENTICATED);
static_assert(kLastCode == static_cast<int>(absl::StatusCode::kUnauthenticated));
static_assert(static_cast<int>(grpc::StatusCode::DATA_LOSS) == static_cast<int>(absl::StatusCode::kDataLoss));

}  // namespace

grpc::Status GrpcFromStatus(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  const absl::Status told = retry::ForCaller(status);
  return {static_cast<grpc::StatusCode>(static_cast<int>(told.code())),
          BoundedLine(std::string(told.message()), kMaxErrorBytes)};
}

absl::Status StatusFromGrpc(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  const int code = static_cast<int>(status.error_code());
  const bool known = code > 0 && code <= kLastCode;
  return {known ? static_cast<absl::StatusCode>(code) : absl::StatusCode::kUnknown, status.error_message()};
}

}  // namespace lumifold::rpc
