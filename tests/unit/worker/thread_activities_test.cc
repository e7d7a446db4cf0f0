#include "worker/leases/thread_activities.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::worker {
namespace {

using testing::ElementsAre;

constexpr absl::Time kStart = absl::UnixEpoch();

absl::Time At(int seconds) { return kStart + absl::Seconds(seconds); }

TEST(ThreadActivities, CountsWhatIsUnderWayToo) {
  ThreadActivities activities(2, kStart);
  activities.Change(Activity::kWaiting, Activity::kRendering, At(1));
  EXPECT_THAT(activities.Spent(At(4)), ElementsAre(absl::Seconds(5), absl::Seconds(3), absl::ZeroDuration()));
  activities.Change(Activity::kRendering, Activity::kSending, At(5));
  activities.Change(Activity::kWaiting, Activity::kRendering, At(6));
  EXPECT_THAT(activities.Spent(At(8)), ElementsAre(absl::Seconds(7), absl::Seconds(6), absl::Seconds(3)));
}

TEST(ThreadActivities, ATimeThatComesLateCountsNothingTwice) {
  ThreadActivities activities(1, kStart);
  EXPECT_THAT(activities.Spent(At(5)),
              ElementsAre(absl::Seconds(5), absl::ZeroDuration(), absl::ZeroDuration()));
  activities.Change(Activity::kWaiting, Activity::kRendering, At(4));
  EXPECT_THAT(activities.Spent(At(6)), ElementsAre(absl::Seconds(5), absl::Seconds(1), absl::ZeroDuration()));
}

}  // namespace
}  // namespace lumifold::worker
