#include "proto/rpc/reconnect_schedule.h"

#include <gtest/gtest.h>

#include <deque>

namespace lumifold::rpc {
namespace {

TEST(ReconnectSchedule, DoublesItsPausesUpToFiveSeconds) {
  ReconnectSchedule schedule([] { return 0.0; });
  for (const int milliseconds : {200, 400, 800, 1600, 3200, 5000, 5000, 5000})
    EXPECT_EQ(schedule.NextPause(), absl::Milliseconds(milliseconds));
}

TEST(ReconnectSchedule, ShortensEachPauseAtRandomByUpToAHalf) {
  std::deque<double> random = {0.5, 1.0, 0.0, 0.25};
  ReconnectSchedule schedule([&] {
    const double next = random.front();
    random.pop_front();
    return next;
  });
  for (const int milliseconds : {150, 200, 800, 1400})  // of 200, 400, 800 and 1600
    EXPECT_EQ(schedule.NextPause(), absl::Milliseconds(milliseconds));
}

TEST(ReconnectSchedule, IsNeverLongerThanFiveSecondsHoweverLongTheOutage) {
  ReconnectSchedule schedule([] { return 0.0; });
  for (int i = 0; i < 10'000; ++i) EXPECT_LE(schedule.NextPause(), absl::Seconds(5));
}

TEST(ReconnectSchedule, BeginsAgainWhenThePeerWasReached) {
  ReconnectSchedule schedule([] { return 0.0; });
  for (int i = 0; i < 10; ++i) schedule.NextPause();
  schedule.Reset();
  EXPECT_EQ(schedule.NextPause(), kFirstReconnectPause);
}

}  // namespace
}  // namespace lumifold::rpc
