#include "server/scheduler/backoffs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/scheduler/unit_names.h"

namespace lumifold::scheduler {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class BackoffsTest : public ::testing::Test {
 protected:
  /// Of the first job's longest pause.
  Place LongestPlace() const { return backoffs_.LongestOf(7).value_or(Backoffs::Pause{}).place; }

  Backoffs backoffs_{{.backoff = {.first = absl::Seconds(1), .longest = absl::Seconds(10)}}};
};

TEST_F(BackoffsTest, APauseDoublesWithEachFailureUpToTheLongest) {
  EXPECT_EQ(backoffs_.LengthAfter(1), absl::Seconds(1));
  EXPECT_EQ(backoffs_.LengthAfter(2), absl::Seconds(2));
  EXPECT_EQ(backoffs_.LengthAfter(4), absl::Seconds(8));
  EXPECT_EQ(backoffs_.LengthAfter(5), absl::Seconds(10));
  EXPECT_EQ(backoffs_.LengthAfter(1000), absl::Seconds(10));
}

TEST_F(BackoffsTest, AUnitPausesUntilTheEndAndNoLonger) {
  backoffs_.Begin(kFirst, kNow);
  EXPECT_EQ(backoffs_.NextEnd(), kNow);
  EXPECT_THAT(backoffs_.TakeEnded(kNow - absl::Nanoseconds(1)), IsEmpty());
  EXPECT_THAT(backoffs_.TakeEnded(kNow), ElementsAre(kFirst));
  EXPECT_THAT(backoffs_.TakeEnded(kNow), IsEmpty());
  EXPECT_EQ(backoffs_.NextEnd(), absl::InfiniteFuture());
}

TEST_F(BackoffsTest, ALaterFailurePutsTheEndOff) {
  backoffs_.Begin(kFirst, kNow + absl::Seconds(1));
  backoffs_.Begin(kFirst, kNow + absl::Seconds(2));
  EXPECT_EQ(backoffs_.CountOf(7), 1);
  EXPECT_THAT(backoffs_.TakeEnded(kNow + absl::Seconds(1)), IsEmpty());
  EXPECT_THAT(backoffs_.TakeEnded(kNow + absl::Seconds(2)), ElementsAre(kFirst));
}

TEST_F(BackoffsTest, AUnitThatIsRenderedPausesNoMore) {
  backoffs_.Begin(kFirst, kNow);
  backoffs_.Begin(kSecond, kNow);
  backoffs_.End(kFirst);
  backoffs_.End(kOfOther);  // does not pause
  EXPECT_EQ(LongestPlace(), kSecond.place);
  EXPECT_THAT(backoffs_.TakeEnded(kNow), ElementsAre(kSecond));
}

TEST_F(BackoffsTest, PausesEndInTheOrderOfTheirEnds) {
  backoffs_.Begin(kFirst, kNow + absl::Seconds(2));
  backoffs_.Begin(kOfOther, kNow + absl::Seconds(1));
  backoffs_.Begin(kSecond, kNow + absl::Seconds(3));
  EXPECT_THAT(backoffs_.TakeEnded(kNow + absl::Seconds(2)), ElementsAre(kOfOther, kFirst));
}

TEST_F(BackoffsTest, TheLongestPauseIsThatOfTheJob) {
  EXPECT_FALSE(backoffs_.LongestOf(7).has_value());
  backoffs_.Begin(kFirst, kNow + absl::Seconds(2));
  backoffs_.Begin(kSecond, kNow + absl::Seconds(1));
  backoffs_.Begin(kOfOther, kNow + absl::Seconds(9));
  EXPECT_EQ(backoffs_.CountOf(7), 2);
  EXPECT_EQ(backoffs_.CountOf(8), 1);
  EXPECT_EQ(LongestPlace(), kFirst.place);
  EXPECT_EQ(backoffs_.LongestOf(7).value_or(Backoffs::Pause{}).end, kNow + absl::Seconds(2));
}

TEST_F(BackoffsTest, AJobThatIsForgottenLeavesThePausesOfOthers) {
  backoffs_.Begin(kFirst, kNow);
  backoffs_.Begin(kOfOther, kNow + absl::Seconds(1));
  backoffs_.ForgetJob(7);
  EXPECT_EQ(backoffs_.CountOf(7), 0);
  EXPECT_EQ(backoffs_.NextEnd(), kNow + absl::Seconds(1));
  EXPECT_THAT(backoffs_.TakeEnded(absl::InfiniteFuture()), ElementsAre(kOfOther));
}

}  // namespace
}  // namespace lumifold::scheduler
