#include "server/page/page_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::page {
namespace {

using ::testing::HasSubstr;

const absl::Time kNow = absl::FromUnixSeconds(1'800'000'000);

v1::PageSession Session(absl::Time end = kNow + absl::Hours(1)) {
  v1::PageSession session;
  session.set_credential("t-1");
  session.set_job_id("j-7");
  session.set_expires_unix_ms(absl::ToUnixMillis(end));
  return session;
}

TEST(SessionSeal, OpensWhatItSealed) {
  const SessionSeal seal("secret");
  const absl::StatusOr<v1::PageSession> opened = seal.Open(seal.Seal(Session()), kNow);
  ASSERT_TRUE(opened.ok()) << opened.status();
  EXPECT_EQ(opened->SerializeAsString(), Session().SerializeAsString());
  EXPECT_EQ(SessionSeal("secret").Open(seal.Seal(Session()), kNow)->job_id(), "j-7")
      << "of another coordinator";
}

TEST(SessionSeal, EndsWithItsTime) {
  const SessionSeal seal("secret");
  const std::string text = seal.Seal(Session(kNow));
  EXPECT_TRUE(seal.Open(text, kNow - absl::Milliseconds(1)).ok());
  const absl::Status ended = seal.Open(text, kNow).status();
  EXPECT_TRUE(absl::IsUnauthenticated(ended));
  EXPECT_THAT(std::string(ended.message()), HasSubstr("expired"));
}

TEST(SessionSeal, EveryChangeIsSeen) {
  const SessionSeal seal("secret");
  const std::string text = seal.Seal(Session());
  for (size_t i = 0; i < text.size(); ++i) {
    std::string changed = text;
    changed[i] = changed[i] == 'a' ? 'b' : 'a';
    EXPECT_FALSE(seal.Open(changed, kNow).ok()) << i;
    EXPECT_FALSE(seal.Open(text.substr(0, i), kNow).ok()) << i;
  }
  EXPECT_FALSE(SessionSeal("another").Open(text, kNow).ok());
  for (const char* text_of_others : {"", ".", "..", "x.y", "\xff.\xff"})
    EXPECT_TRUE(absl::IsUnauthenticated(seal.Open(text_of_others, kNow).status())) << text_of_others;
  EXPECT_FALSE(seal.Open(std::string(1 << 20, 'a'), kNow).ok());
}

}  // namespace
}  // namespace lumifold::page
