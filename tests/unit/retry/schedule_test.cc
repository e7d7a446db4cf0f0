#include "proto/retry/schedule.h"

#include <gtest/gtest.h>

#include <deque>

namespace lumifold::retry {
namespace {

constexpr Pauses kPauses = {.first = absl::Milliseconds(200), .longest = absl::Seconds(5)};

TEST(Schedule, DoublesItsPausesUpToTheLongest) {
  Schedule schedule(kPauses);
  for (const int milliseconds : {200, 400, 800, 1600, 3200, 5000, 5000, 5000})
    EXPECT_EQ(schedule.Next(), absl::Milliseconds(milliseconds));
  EXPECT_EQ(schedule.failures(), 8);
}

TEST(Schedule, ShortensEachPauseAtRandomByUpToAHalf) {
  std::deque<double> random = {0.5, 1.0, 0.0, 0.25};
  Schedule schedule(kPauses, [&] {
    const double next = random.front();
    random.pop_front();
    return next;
  });
  for (const int milliseconds : {150, 200, 800, 1400})  // of 200, 400, 800 and 1600
    EXPECT_EQ(schedule.Next(), absl::Milliseconds(milliseconds));
}

TEST(Schedule, BeginsAgainAfterASuccess) {
  Schedule schedule(kPauses);
  for (int i = 0; i < 10; ++i) schedule.Next();
  schedule.Reset();
  EXPECT_EQ(schedule.failures(), 0);
  EXPECT_EQ(schedule.Next(), kPauses.first);
  EXPECT_EQ(schedule.Next(), 2 * kPauses.first);
}

}  // namespace
}  // namespace lumifold::retry
