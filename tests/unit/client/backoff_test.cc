#include "client/farm/backoff.h"

#include <gtest/gtest.h>

#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

class BackoffTest : public testing::Test {
 protected:
  Backoff Make(absl::Duration patience) {
    return {patience, time_.Environment(), [this] { return interrupted_; }};
  }
  // Duration of one pause.
  absl::Duration Pause(Backoff& backoff) {
    const absl::Time begin = time_.now;
    EXPECT_TRUE(backoff.Pause());
    return time_.now - begin;
  }

  FakeTime time_;
  bool interrupted_ = false;
};

TEST_F(BackoffTest, PausesLongerEachTimeUpToALimit) {
  Backoff backoff = Make(absl::Hours(1));
  EXPECT_EQ(Pause(backoff), absl::Milliseconds(200));
  EXPECT_EQ(Pause(backoff), absl::Milliseconds(400));
  for (int i = 0; i < 10; ++i) Pause(backoff);
  EXPECT_EQ(Pause(backoff), absl::Seconds(5));
}

TEST_F(BackoffTest, GivesUpWhenNothingMoves) {
  Backoff backoff = Make(absl::Seconds(10));
  while (backoff.Pause()) {
  }
  EXPECT_GE(time_.now - absl::UnixEpoch(), absl::Seconds(10));
  EXPECT_LT(time_.now - absl::UnixEpoch(), absl::Seconds(15));
}

TEST_F(BackoffTest, IsAsPatientAsBeforeOnceSomethingMoved) {
  Backoff backoff = Make(absl::Seconds(1));
  while (backoff.Pause()) {
  }
  backoff.Reset();
  EXPECT_EQ(Pause(backoff), absl::Milliseconds(200));
}

TEST_F(BackoffTest, DoesNotSleepOnceInterrupted) {
  Backoff backoff = Make(absl::Hours(1));
  interrupted_ = true;
  EXPECT_FALSE(backoff.Pause());
  EXPECT_EQ(time_.sleeps, 0);
}

}  // namespace
}  // namespace lumifold::client
