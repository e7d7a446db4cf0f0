#include "proto/rpc/monotonic.h"

#include <grpc/support/time.h>
#include <gtest/gtest.h>

namespace lumifold::rpc {
namespace {

TEST(Monotonic, TimeNeverGoesBack) {
  const absl::Time before = MonotonicNow();
  EXPECT_LE(before, MonotonicNow());
}

TEST(Monotonic, DeadlinesAreOfTheMonotonicClock) {
  const gpr_timespec deadline = MonotonicDeadline(absl::Seconds(100));
  EXPECT_EQ(deadline.clock_type, GPR_CLOCK_MONOTONIC);
  const double seconds = gpr_timespec_to_micros(gpr_time_sub(deadline, gpr_now(GPR_CLOCK_MONOTONIC))) * 1e-6;
  EXPECT_GT(seconds, 90);
  EXPECT_LE(seconds, 100);
}

TEST(Monotonic, TimeUntilADeadlineOfEitherClock) {
  EXPECT_GT(TimeUntil(MonotonicDeadline(absl::Seconds(100))), absl::Seconds(90));
  const gpr_timespec wall =
      gpr_time_add(gpr_now(GPR_CLOCK_REALTIME), gpr_time_from_seconds(100, GPR_TIMESPAN));
  EXPECT_GT(TimeUntil(wall), absl::Seconds(90));
  EXPECT_LE(TimeUntil(wall), absl::Seconds(100));
  EXPECT_EQ(TimeUntil(gpr_inf_future(GPR_CLOCK_REALTIME)), absl::InfiniteDuration());
  EXPECT_LT(TimeUntil(gpr_time_0(GPR_CLOCK_MONOTONIC)), absl::ZeroDuration());
}

}  // namespace
}  // namespace lumifold::rpc
