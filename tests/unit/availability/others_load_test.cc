#include "worker/availability/others_load.h"

#include <gtest/gtest.h>

namespace lumifold::worker {
namespace {

class OthersLoadTest : public testing::Test {
 protected:
  /// Others, and this process with as many threads, keep so many cores busy for a time.
  void Run(double others, double own, absl::Duration time) {
    for (absl::Duration passed; passed < time; passed += absl::Seconds(1)) {
      now_ += absl::Seconds(1);
      times_.machine += others + own;
      times_.own += own;
      load_.Note(times_, now_);
    }
  }

  absl::Time now_ = absl::FromUnixSeconds(1000);
  CpuTimes times_ = {.machine = 5e6, .own = 7};
  OthersLoad load_{0.5};
};

TEST_F(OthersLoadTest, IsWhatThisProcessDoesNotUse) {
  Run(0.25, 7.5, absl::Seconds(5));
  EXPECT_FALSE(load_.load().has_value());
  Run(0.25, 7.5, absl::Seconds(10));
  EXPECT_NEAR(load_.load().value(), 0.25, 1e-9);
  Run(-0.5, 1, absl::Seconds(20));
  EXPECT_EQ(load_.load().value(), 0) << "the kernel's ticks are coarse";
}

TEST_F(OthersLoadTest, AMachineIsIdleAfterAMinuteBelowTheLimit) {
  Run(0.1, 0, absl::Seconds(55));
  EXPECT_FALSE(load_.IsIdle());
  Run(0.1, 0, absl::Seconds(10));
  EXPECT_TRUE(load_.IsIdle());
  Run(0.1, 8, absl::Minutes(10));
  EXPECT_TRUE(load_.IsIdle()) << "its own load does not count";
}

TEST_F(OthersLoadTest, AMachineIsInUseSoonAndPausesAreShort) {
  Run(0, 2, absl::Minutes(2));
  Run(1, 2, absl::Seconds(3));
  EXPECT_TRUE(load_.IsIdle()) << "a moment";
  Run(1, 2, absl::Seconds(5));
  EXPECT_FALSE(load_.IsIdle());
  for (int i = 0; i < 5; ++i) {
    Run(0, 0, absl::Seconds(40));
    EXPECT_FALSE(load_.IsIdle());
    Run(2, 0, absl::Seconds(5));
    EXPECT_FALSE(load_.IsIdle());
  }
  Run(0, 0, absl::Seconds(75));
  EXPECT_TRUE(load_.IsIdle());
}

TEST(CpuClock, CountsThisProcess) {
  const absl::StatusOr<std::unique_ptr<CpuClock>> clock = CpuClock::Open();
  ASSERT_TRUE(clock.ok()) << clock.status();
  const std::optional<CpuTimes> before = (*clock)->Read();
  ASSERT_TRUE(before.has_value());
  volatile double work = 1;
  while ((*clock)->Read()->own < before->own + 0.1) work = work * 1.0000001;
  EXPECT_GT((*clock)->Read()->machine, before->machine);
}

}  // namespace
}  // namespace lumifold::worker
