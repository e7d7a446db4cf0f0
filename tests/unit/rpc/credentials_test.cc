#include "proto/rpc/credentials.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::rpc {
namespace {

using ::testing::HasSubstr;

TEST(Credentials, KnowsLoopback) {
  for (const char* address :
       {"127.0.0.1:7700", "127.1.2.3:0", "localhost:1", "[::1]:7700", "unix:/tmp/socket"}) {
    EXPECT_TRUE(IsLoopback(address)) << address;
  }
  for (const char* address :
       {"0.0.0.0:7700", "[::]:7700", "10.0.0.1:7700", "127.example.org:80", "localhost.org:1"}) {
    EXPECT_FALSE(IsLoopback(address)) << address;
  }
}

Security Insecure() {
  Security security;
  security.insecure = true;
  return security;
}

TEST(Credentials, ClosedByDefaultOffLoopback) {
  EXPECT_TRUE(CheckListenAddress("127.0.0.1:0", {}).ok());
  const absl::Status status = CheckListenAddress("0.0.0.0:7700", {});
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("0.0.0.0:7700"));
  EXPECT_THAT(std::string(status.message()), HasSubstr("--insecure"));
  EXPECT_TRUE(CheckListenAddress("0.0.0.0:7700", Insecure()).ok());
}

TEST(Credentials, BadAddressIsNamed) {
  for (const char* address : {"", "7700", ":7700", "localhost", "localhost:", "localhost:x",
                              "localhost:65536", "localhost:-1", "::1:7700"}) {
    const absl::Status status = CheckListenAddress(address, Insecure());
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << address;
    EXPECT_THAT(std::string(status.message()), HasSubstr(std::string("'") + address + "'"));
  }
}

}  // namespace
}  // namespace lumifold::rpc
