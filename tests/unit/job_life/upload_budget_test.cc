#include "server/job_life/upload_budget.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::job_life {
namespace {

using ::testing::HasSubstr;

TEST(UploadBudget, ExpectedBytesOfAllUploadsMustFit) {
  UploadBudget budget;
  EXPECT_TRUE(budget.Expect("wood.png", 60, 100).ok());
  const absl::Status refused = budget.Expect("oak.png", 41, 100);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(refused.message()),
              HasSubstr("oak.png: 41 bytes are to come, but there is room for 100"));
  EXPECT_TRUE(budget.Expect("oak.png", 40, 100).ok());
  EXPECT_EQ(budget.expected_bytes(), 100u);
}

// 60 bytes came, so the disk has room for 40 only: the rest of the budget is what it was.
TEST(UploadBudget, BytesThatArrivedAreNotCountedTwice) {
  UploadBudget budget;
  EXPECT_TRUE(budget.Expect("wood.png", 90, 100).ok());
  budget.Arrived(60);
  EXPECT_TRUE(budget.Expect("oak.png", 10, 40).ok());
  EXPECT_FALSE(budget.Expect("elm.png", 1, 40).ok());
}

TEST(UploadBudget, AnUploadThatEndsGivesBackWhatDidNotArrive) {
  UploadBudget budget;
  EXPECT_TRUE(budget.Begin("wood.png").ok());
  EXPECT_TRUE(budget.Expect("wood.png", 90, 100).ok());
  budget.Arrived(10);
  budget.End(80);
  EXPECT_EQ(budget.expected_bytes(), 0u);
  EXPECT_EQ(budget.uploads(), 0);
}

TEST(UploadBudget, TheNumberOfUploadsIsBounded) {
  UploadBudget budget;
  for (int i = 0; i < kMaxUploads; ++i) EXPECT_TRUE(budget.Begin("wood.png").ok());
  EXPECT_EQ(budget.Begin("wood.png").code(), absl::StatusCode::kResourceExhausted);
  budget.End(0);
  EXPECT_TRUE(budget.Begin("wood.png").ok());
}

TEST(UploadBudget, HugeAnnouncementsDoNotOverflow) {
  UploadBudget budget;
  EXPECT_TRUE(budget.Expect("a", uint64_t{1} << 63, ~uint64_t{0}).ok());
  EXPECT_FALSE(budget.Expect("b", uint64_t{1} << 63, ~uint64_t{0}).ok());
  EXPECT_FALSE(budget.Expect("c", ~uint64_t{0}, 0).ok());
}

}  // namespace
}  // namespace lumifold::job_life
