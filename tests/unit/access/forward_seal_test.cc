#include "server/access/forward_seal.h"

#include <gtest/gtest.h>

#include <string>

#include "absl/strings/str_cat.h"

namespace lumifold::access {
namespace {

using absl::StatusCode;

const absl::Time kNow = absl::FromUnixSeconds(1'700'000'000);

TEST(ForwardSealTest, WhoHasTheKeyOpensIt) {
  const ForwardSeal first("key");
  const ForwardSeal second("key");
  for (const std::string id : {"t-17", "", "a.b.c", "\n"}) {
    const auto opened = second.Open(first.Make(id, kNow), kNow + absl::Minutes(4));
    ASSERT_TRUE(opened.ok()) << opened.status();
    EXPECT_EQ(*opened, id);
  }
}

TEST(ForwardSealTest, NothingElseIsOpened) {
  const ForwardSeal seal("key");
  const std::string good = seal.Make("t-17", kNow);
  EXPECT_EQ(ForwardSeal("other").Open(good, kNow).status().code(), StatusCode::kUnauthenticated);
  for (size_t i = 0; i < good.size(); ++i) {
    std::string changed = good;
    changed[i] = static_cast<char>(changed[i] ^ 1);
    EXPECT_FALSE(seal.Open(changed, kNow).ok()) << changed;
    EXPECT_FALSE(seal.Open(good.substr(0, i), kNow).ok()) << i;
  }
  for (const std::string& text :
       {std::string(), std::string("."), std::string(".."), std::string(1000, '.'), good + "0"})
    EXPECT_FALSE(seal.Open(text, kNow).ok()) << text;
}

TEST(ForwardSealTest, ASealIsOfUseForMinutes) {
  const ForwardSeal seal("key");
  const std::string good = seal.Make("t-17", kNow);
  EXPECT_TRUE(seal.Open(good, kNow - absl::Minutes(4)).ok());
  EXPECT_FALSE(seal.Open(good, kNow + absl::Minutes(6)).ok());
  EXPECT_FALSE(seal.Open(good, kNow - absl::Minutes(6)).ok());
}

}  // namespace
}  // namespace lumifold::access
