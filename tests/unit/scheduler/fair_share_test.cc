#include "server/scheduler/fair_share.h"

#include <gtest/gtest.h>

#include <deque>
#include <map>
#include <string>

#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

class FairShareTest : public ::testing::Test {
 protected:
  /// A farm of `slots`, which are all busy; units take ten seconds. Returns how often each job was served.
  std::map<int64_t, int> Serve(int slots, int times) {
    std::map<int64_t, int> served;
    for (int i = 0; i < times; ++i) {
      while (static_cast<int>(held_.size()) >= slots) End();
      now_ += absl::Seconds(10) / slots;
      const FairShare::Candidate first = *share_.First(queue_, {});
      const int64_t job = first.job;
      share_.Choose(first);
      share_.Granted(job, now_);
      held_.push_back(job);
      ++served[job];
    }
    return served;
  }

  void End() {
    share_.Ended(held_.front(), absl::Seconds(10));
    held_.pop_front();
  }

  /// Turns fall with the numbers: the job that was added last comes first.
  void Add(int64_t job, const std::string& user, int priority = 0) {
    share_.AddJob(job, user, priority, /*turn=*/-job);
    share_.SetQueue(job, &queue_, now_);
  }

  absl::Time now_ = kStart;
  FairShare share_;
  FairShare::Queue queue_;
  std::deque<int64_t> held_;
};

TEST_F(FairShareTest, UsersShareEquallyAndEachOnesJobsTakeTurns) {
  for (int job = 0; job < 9; ++job) Add(job, "ann");
  Add(9, "ben");
  for (const int slots : {1, 7, 180}) {
    auto served = Serve(slots, 1800);
    EXPECT_NEAR(served[9], 900, 20) << slots;
    EXPECT_NEAR(served[8], 900, 20) << slots;
    EXPECT_EQ(served.size(), 2u) << "the jobs behind the first one wait";
  }
  share_.SetQueue(8, nullptr, now_);
  EXPECT_NEAR(Serve(7, 100)[7], 50, 5) << "until it has nothing for the slots";
  share_.SetQueue(8, &queue_, now_);
  EXPECT_NEAR(Serve(7, 100)[8], 50, 5);
  while (!held_.empty()) End();
  share_.RemoveJob(8);
  EXPECT_NEAR(Serve(7, 100)[7], 50, 5);
}

TEST_F(FairShareTest, AJobOfAnotherPriorityTakesTurnsWithThoseOfThat) {
  Add(1, "ann", 10);
  Add(2, "ann");
  Add(3, "ann");
  EXPECT_NEAR(Serve(6, 600)[1], 400, 10) << "twice the weight";
  share_.SetPriority(1, 0);
  auto served = Serve(6, 600);
  EXPECT_EQ(served[1] + served[2], 0) << "the third one comes first";
  share_.SetPriority(3, -10);
  served = Serve(6, 600);
  EXPECT_NEAR(served[2], 400, 10);
  EXPECT_NEAR(served[3], 200, 10);
}

TEST_F(FairShareTest, ATurnHoldsAcrossQueues) {
  FairShare::Queue other;
  share_.AddJob(1, "ann", 0, 1);
  share_.AddJob(2, "ann", 0, 2);
  share_.SetQueue(1, &other, now_);
  share_.SetQueue(2, &queue_, now_);
  const FairShare::Candidate first = *share_.First(other, {});
  EXPECT_LT(first, *share_.First(queue_, {}));
  EXPECT_FALSE(share_.IsNear(2, first, {100, 1, 1})) << "nor does a loaded scene change that";
}

TEST_F(FairShareTest, TenPrioritiesDoubleTheShare) {
  Add(1, "ann", 20);
  Add(2, "ann", 10);
  Add(3, "ben", 10);
  for (const int slots : {1, 2, 90}) {
    auto served = Serve(slots, 1800);  // ann has twice the weight of ben, and job 1 twice that of job 2
    EXPECT_NEAR(served[1], 800, 25) << slots;
    EXPECT_NEAR(served[2], 400, 25) << slots;
    EXPECT_NEAR(served[3], 600, 25) << slots;
  }
  share_.SetPriority(3, 20);
  EXPECT_NEAR(Serve(1, 900)[3], 450, 20);
}

TEST_F(FairShareTest, WhoComesLaterHasNoClaimOnTheTimeBefore) {
  Add(1, "ann");
  Serve(1, 1000);
  Add(2, "ben");
  EXPECT_NEAR(Serve(1, 100)[2], 50, 7);
  share_.SetQueue(2, nullptr, now_);
  Serve(1, 1000);
  share_.SetQueue(2, &queue_, now_);
  EXPECT_NEAR(Serve(1, 100)[2], 50, 7) << "nor has who was idle";
}

TEST_F(FairShareTest, WhoUsedAnIdleFarmDoesNotPayForItLater) {
  Add(1, "ann");
  Serve(100, 1000);
  Add(2, "ben");
  Serve(100, 100);  // all slots of ann have ended
  EXPECT_NEAR(Serve(100, 100)[1], 50, 5);
}

TEST_F(FairShareTest, WhoCouldNotBeServedDoesNotTakeTheFarmWhenItCan) {
  FairShare::Queue other;
  share_.AddJob(2, "ben", 0, 0);
  share_.SetQueue(2, &other, now_);  // nobody serves it
  Add(1, "ann");
  Serve(10, 10'000);
  share_.SetQueue(2, &queue_, now_);
  EXPECT_NEAR(Serve(10, 1000)[1], 500, 20);
}

TEST_F(FairShareTest, SaysWhichJobsAreNearTheirShare) {
  Add(1, "ann");
  Add(2, "ben");
  for (int i = 0; i < 3; ++i) share_.Granted(1, now_);
  const FairShare::Candidate first = *share_.First(queue_, {});
  EXPECT_EQ(first.job, 2);
  EXPECT_EQ(share_.First(queue_, {2})->job, 1);
  EXPECT_FALSE(share_.First(queue_, {1, 2}).has_value());
  EXPECT_TRUE(share_.IsNear(1, first, {3, 0, 0}));
  EXPECT_FALSE(share_.IsNear(1, first, {2.9, 0, 0}));
  EXPECT_TRUE(share_.IsNear(1, first, {0, 1, 1}));
  EXPECT_DOUBLE_EQ(share_.ShareOfUser(1), 0.5);
}

TEST_F(FairShareTest, KnowsWhoHasWaitedLongest) {
  EXPECT_FALSE(share_.LongestWaiting(queue_).has_value());
  Add(1, "ann");
  now_ += absl::Seconds(1);
  Add(2, "ben");
  EXPECT_EQ(share_.LongestWaiting(queue_)->second, 1);
  share_.Granted(1, now_ + absl::Seconds(1));
  EXPECT_EQ(share_.LongestWaiting(queue_)->second, 2);
  share_.RemoveJob(2);
  EXPECT_EQ(share_.LongestWaiting(queue_)->first, kStart + absl::Seconds(2));
}

}  // namespace
}  // namespace lumifold::scheduler
