#include "server/services/stall_clock.h"

#include <gtest/gtest.h>

namespace lumifold::server {
namespace {

absl::Time At(int seconds) { return absl::UnixEpoch() + absl::Seconds(seconds); }

TEST(StallClock, AllowsItsLimitForEachStep) {
  StallClock clock(absl::Seconds(10), 100);
  EXPECT_EQ(clock.Await(At(0)), At(10));
  clock.Restart();
  EXPECT_EQ(clock.Await(At(9)), At(19));
}

TEST(StallClock, FewBytesGainNoTime) {
  StallClock clock(absl::Seconds(10), 100);
  clock.Await(At(0));
  clock.Move(At(4), 1);
  EXPECT_EQ(clock.Await(At(4)), At(10));
  clock.Move(At(7), 98);
  EXPECT_EQ(clock.Await(At(7)), At(10));
}

TEST(StallClock, EnoughBytesBeginANewWindow) {
  StallClock clock(absl::Seconds(10), 100);
  clock.Await(At(0));
  clock.Move(At(4), 60);
  clock.Await(At(4));
  clock.Move(At(9), 60);
  EXPECT_EQ(clock.Await(At(9)), At(19));
  // What was more than enough does not count twice.
  clock.Move(At(10), 99);
  EXPECT_EQ(clock.Await(At(10)), At(19));
}

TEST(StallClock, OwnTurnsTakeNoTime) {
  StallClock clock(absl::Seconds(10), 100);
  clock.Await(At(0));
  clock.Move(At(4), 1);
  EXPECT_EQ(clock.Await(At(1000)), At(1006));
}

TEST(StallClock, WhoIsLateStaysLate) {
  StallClock clock(absl::Seconds(10), 100);
  clock.Await(At(0));
  clock.Move(At(30), 1);
  EXPECT_LE(clock.Await(At(30)), At(30));
}

TEST(StallClock, WithoutALimitNothingStalls) {
  StallClock clock(absl::InfiniteDuration(), 100);
  EXPECT_EQ(clock.Await(At(0)), absl::InfiniteFuture());
  clock.Move(At(30), 1);
  EXPECT_EQ(clock.Await(At(30)), absl::InfiniteFuture());
}

}  // namespace
}  // namespace lumifold::server
