#include "proto/identity/secrets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/prctl.h>

#include <sstream>
#include <string>

#include "proto/identity/join.h"

namespace lumifold::identity {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Code AnyCode() { return {.ca_sha256 = HashOf("authority"), .secret = *RandomBytes(kCodeSecretBytes)}; }

TEST(Secrets, ACodeIsWhatItsTextSays) {
  const Code code = AnyCode();
  const std::string text = TextOfCode(code);
  EXPECT_EQ(text.size(), 9u + 64u);
  const absl::StatusOr<Code> parsed = ParseCode(text);
  ASSERT_TRUE(parsed.ok());
  EXPECT_EQ(parsed->ca_sha256, code.ca_sha256);
  EXPECT_EQ(parsed->secret, code.secret);
}

TEST(Secrets, WhatIsNoCodeIsNotShown) {
  const std::string text = TextOfCode(AnyCode());
  for (const std::string& bad :
       {std::string(), std::string("lumifold-"), text.substr(1), text + "A", text.substr(0, 72),
        text.substr(0, 72) + "+", text.substr(0, 72) + "=", text.substr(0, 72) + " ",
        text.substr(0, 72) + std::string(1, '\0'), std::string(1 << 20, 'A')}) {
    const absl::Status status = ParseCode(bad).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    if (bad.size() > 9) {
      EXPECT_THAT(std::string(status.message()), Not(HasSubstr(bad.substr(9, 20))));
    }
  }
}

TEST(Secrets, ACodeComesFromTheArgumentOrStandardInput) {
  const std::string text = TextOfCode(AnyCode());
  EXPECT_EQ(*ReadCode(text, nullptr, nullptr), text);
  for (const char* argument : {"", "-"}) {
    std::istringstream in("  " + text + " \r\nmore");
    std::ostringstream err;
    EXPECT_EQ(*ReadCode(argument, &in, &err), text);
    EXPECT_EQ(err.str(), "Code: ");
  }
  std::istringstream empty;
  EXPECT_FALSE(ReadCode("-", &empty, nullptr).ok());
  EXPECT_FALSE(ReadCode("-", nullptr, nullptr).ok());
}

TEST(Secrets, NoTwoTokensAreEqual) {
  const std::string one = *MakeToken();
  EXPECT_NE(one, *MakeToken());
  EXPECT_EQ(one.size(), 9u + 43u);
  EXPECT_LE(one.size(), kMaxSecretTextBytes);
}

TEST(Secrets, HashesAreThoseOfSha256) {
  EXPECT_EQ(SecretText(HashOf("abc")), "ungWv48Bz-pBQUDeXa4iI7ADYaOWF3qctBD_YfIAFa0");
}

TEST(Secrets, AProtectedProcessLeavesNoCoreDump) {
  // In a child: the protection cannot be seen from outside, and it would hold for the other tests too.
  EXPECT_EXIT(
      {
        ProtectMemory();
        _exit(prctl(PR_GET_DUMPABLE));
      },
      ::testing::ExitedWithCode(0), "");
  EXPECT_EQ(prctl(PR_GET_DUMPABLE), 1);
}

}  // namespace
}  // namespace lumifold::identity
