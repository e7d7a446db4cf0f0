#include "server/assets/upload_budget.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;

constexpr uint64_t kNoLimit = ~uint64_t{0};

TEST(UploadBudget, AnnouncedBytesOfAllUploadsMustFit) {
  UploadBudget budget;
  EXPECT_TRUE(budget.Begin("ann", "wood.png", 60, 100).ok());
  const absl::Status refused = budget.Begin("bob", "oak.png", 41, 100);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(refused.message()),
              HasSubstr("oak.png: 41 bytes are to come, but there is room for 100"));
  EXPECT_TRUE(budget.Begin("bob", "oak.png", 40, 100).ok());
  EXPECT_EQ(budget.expected_bytes(), 100u);
  EXPECT_EQ(budget.uploads(), 2);
}

// 60 bytes came, so the disk has room for 40 only: the rest of the budget is what it was.
TEST(UploadBudget, BytesThatArrivedAreNotCountedTwice) {
  UploadBudget budget;
  EXPECT_TRUE(budget.Begin("ann", "wood.png", 90, 100).ok());
  budget.Arrived("ann", 60);
  EXPECT_TRUE(budget.Begin("ann", "oak.png", 10, 40).ok());
  EXPECT_FALSE(budget.Begin("ann", "elm.png", 1, 40).ok());
}

TEST(UploadBudget, AnUploadThatStartsOverNeedsRoomForMore) {
  UploadBudget budget({.bytes_of_caller = 50});
  EXPECT_TRUE(budget.Begin("ann", "wood.png", 30, 100).ok());
  EXPECT_FALSE(budget.Expect("ann", "wood.png", 21, 100).ok());
  EXPECT_TRUE(budget.Expect("ann", "wood.png", 20, 100).ok());
  EXPECT_FALSE(budget.Begin("ann", "oak.png", 1, 100).ok());
  budget.End("ann", 50);
  EXPECT_TRUE(budget.Begin("ann", "oak.png", 50, 100).ok());
}

TEST(UploadBudget, AnUploadThatEndsGivesBackWhatDidNotArrive) {
  UploadBudget budget;
  EXPECT_TRUE(budget.Begin("ann", "wood.png", 90, 100).ok());
  budget.Arrived("ann", 10);
  budget.End("ann", 80);
  EXPECT_EQ(budget.expected_bytes(), 0u);
  EXPECT_EQ(budget.uploads(), 0);
}

TEST(UploadBudget, TheNumberOfUploadsIsBoundedForAllAndForEach) {
  UploadBudget budget({.uploads = 5, .uploads_of_caller = 3});
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(budget.Begin("ann", "wood.png", 1, kNoLimit).ok());
  const absl::Status of_one = budget.Begin("ann", "wood.png", 1, kNoLimit);
  EXPECT_EQ(of_one.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(of_one.message(),
            "wood.png: 3 uploads of this caller are announced and not complete, as many as one may have");
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(budget.Begin("bob", "oak.png", 1, kNoLimit).ok());
  const absl::Status of_all = budget.Begin("cy", "elm.png", 1, kNoLimit);
  EXPECT_EQ(of_all.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(of_all.message()), HasSubstr("elm.png: 5 uploads are announced"));
  budget.End("ann", 1);
  EXPECT_TRUE(budget.Begin("ann", "wood.png", 1, kNoLimit).ok());
}

TEST(UploadBudget, TwentyAnnouncementsOfATebibyteAreRefused) {
  UploadBudget budget;
  for (int i = 0; i < 20; ++i) {
    const absl::Status refused = budget.Begin("ann", "huge.bin", uint64_t{1} << 40, kNoLimit);
    EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
    EXPECT_THAT(std::string(refused.message()), HasSubstr("one may announce 256000000000"));
  }
  EXPECT_EQ(budget.uploads(), 0);
  EXPECT_EQ(budget.expected_bytes(), 0u);
}

TEST(UploadBudget, HugeAnnouncementsDoNotOverflow) {
  UploadBudget budget({.bytes_of_caller = kNoLimit});
  EXPECT_TRUE(budget.Begin("ann", "a", uint64_t{1} << 63, kNoLimit).ok());
  EXPECT_FALSE(budget.Begin("bob", "b", uint64_t{1} << 63, kNoLimit).ok());
  EXPECT_FALSE(budget.Begin("bob", "c", kNoLimit, 0).ok());
}

}  // namespace
}  // namespace lumifold::server
