#include "server/page/request_checks.h"

#include <gtest/gtest.h>

namespace lumifold::page {
namespace {

TEST(RequestChecks, ANameOfSomebodyElseIsNotOurs) {
  const std::set<std::string> names = {"farm.example"};
  for (const char* host : {"localhost", "localhost:7701", "LOCALHOST", "127.0.0.1:80", "192.168.1.7",
                           "[::1]:7701", "[::1]", "farm.example", "Farm.Example:7701"})
    EXPECT_TRUE(IsOurHost(host, names)) << host;
  for (const char* host :
       {"", ":80", "evil.example", "evil.example:7701", "localhost.evil.example", "127.0.0.1.evil.example",
        "farm.example.evil", "127.1", "[localhost]x", "[", "[]", "0x7f000001", "localhost\n", "a@localhost"})
    EXPECT_FALSE(IsOurHost(host, names)) << host;
  EXPECT_FALSE(IsOurHost("farm.example", {}));
}

TEST(RequestChecks, APageOfAnotherServerIsNotOurs) {
  EXPECT_TRUE(IsOurOrigin("", "http", "localhost:7701")) << "not from a page";
  EXPECT_TRUE(IsOurOrigin("http://localhost:7701", "http", "localhost:7701"));
  for (const char* origin : {"null", "https://localhost:7701", "http://localhost:7702",
                             "http://localhost:7701.evil", "http://localhost:7701/"})
    EXPECT_FALSE(IsOurOrigin(origin, "http", "localhost:7701")) << origin;
}

}  // namespace
}  // namespace lumifold::page
