#include "proto/rpc/status_codec.h"

#include <gtest/gtest.h>

#include <string>

namespace lumifold::rpc {
namespace {

TEST(StatusCodec, KeepsEveryCodeAndTheMessage) {
  for (int code = 1; code <= 16; ++code) {
    const absl::Status status(static_cast<absl::StatusCode>(code), "tile 7: no");
    const grpc::Status sent = GrpcFromStatus(status);
    EXPECT_EQ(static_cast<int>(sent.error_code()), code);
    EXPECT_EQ(StatusFromGrpc(sent), status);
  }
}

TEST(StatusCodec, OkStaysOk) {
  EXPECT_TRUE(GrpcFromStatus(absl::OkStatus()).ok());
  EXPECT_TRUE(StatusFromGrpc(grpc::Status::OK).ok());
}

TEST(StatusCodec, UnknownCodeBecomesUnknown) {
  const absl::Status status = StatusFromGrpc({grpc::StatusCode::DO_NOT_USE, "what"});
  EXPECT_EQ(status.code(), absl::StatusCode::kUnknown);
  EXPECT_EQ(std::string(status.message()), "what");
}

}  // namespace
}  // namespace lumifold::rpc
