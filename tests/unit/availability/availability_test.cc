#include "worker/availability/availability.h"

#include <gtest/gtest.h>

namespace lumifold::worker {
namespace {

TEST(Availability, SaysHowLongAWorkerRests) {
  absl::Time wall = absl::FromCivil(absl::CivilMinute(2026, 11, 6, 12, 0), absl::UTCTimeZone());  // a Friday
  Availability availability({.hours = *WorkingHours::Parse("Mon-Thu 19:00-07:00"),
                             .wall_now = [&wall] { return wall; },
                             .now = [] { return absl::UnixEpoch(); }});
  EXPECT_EQ(availability.RestReason(), "off hours until Mon 19:00");
  wall += absl::Hours(3 * 24);
  EXPECT_EQ(availability.RestReason(), "off hours until 19:00");
  wall += absl::Hours(7);
  EXPECT_EQ(availability.RestReason(), "");
}

TEST(Availability, FollowsTheLoadOfOthersWhenItIsAsked) {
  absl::Time now = absl::UnixEpoch();
  CpuTimes times;
  int reads = 0;
  Availability availability({.max_load = 0.5,
                             .cpu = [&]() -> std::optional<CpuTimes> {
                               ++reads;
                               return times;
                             },
                             .now = [&now] { return now; }});
  EXPECT_EQ(availability.RestReason(), "the load of others is being measured");
  EXPECT_EQ(availability.RestReason(), "the load of others is being measured");
  EXPECT_EQ(reads, 1) << "not more often than once a second";
  for (int i = 0; i < 61; ++i) {
    now += absl::Seconds(1);
    availability.RestReason();
  }
  EXPECT_EQ(availability.RestReason(), "");
  times.machine += 9;
  now += absl::Seconds(1);
  EXPECT_EQ(availability.RestReason(), "others use this machine, limit 0.5 cores");
  for (int i = 0; i < 15; ++i) {
    now += absl::Seconds(1);
    availability.RestReason();
  }
  EXPECT_EQ(availability.RestReason(), "others have used this machine within the last minute");
}

}  // namespace
}  // namespace lumifold::worker
