#include "proto/rpc/sha256.h"

#include <gtest/gtest.h>

namespace lumifold::rpc {
namespace {

// FIPS 180-4: examples of one block and of the empty message.
constexpr char kOfAbc[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
constexpr char kOfNothing[] = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

TEST(Sha256, AgreesWithTheStandard) {
  EXPECT_EQ(Sha256Hex("abc"), kOfAbc);
  EXPECT_EQ(Sha256Hex(""), kOfNothing);
}

TEST(Sha256, PiecesMakeTheSameSum) {
  Sha256 sum;
  sum.Update("a");
  sum.Update("");
  sum.Update("bc");
  EXPECT_EQ(sum.FinishHex(), kOfAbc);
}

TEST(Sha256, OnlyLowerCaseDigitsOfTheRightNumberPass) {
  EXPECT_TRUE(IsSha256Hex(kOfAbc));
  EXPECT_FALSE(IsSha256Hex(""));
  EXPECT_FALSE(IsSha256Hex(std::string(64, 'A')));
  EXPECT_FALSE(IsSha256Hex(std::string(63, 'a')));
  EXPECT_FALSE(IsSha256Hex("../" + std::string(61, 'a')));
}

}  // namespace
}  // namespace lumifold::rpc
