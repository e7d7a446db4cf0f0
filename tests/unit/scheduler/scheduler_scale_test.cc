// The time of a decision hardly depends on the size of the farm.
#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "server/scheduler/scheduler.h"
#include "tests/support/cpu_seconds.h"

namespace lumifold::scheduler {
namespace {

using job::Attempt;
using job::JobId;
using job::WorkerId;

constexpr int kDecisions = 2'000;

/// CPU seconds of commits, heartbeats, grants and checks of deadlines on a farm whose slots are all leased.
double SecondsOfDecisions(int workers, int jobs) {
  const absl::Time now = absl::FromUnixSeconds(1'000'000);
  Scheduler scheduler({});
  v1::JobSpec spec;
  spec.set_width(1920);
  spec.set_height(1080);
  spec.set_tile_size(32);
  spec.set_samples_per_pixel(256);
  spec.set_pass_samples(64);
  spec.set_frame_count(4);
  for (int i = 0; i < jobs; ++i) scheduler.AddJob(JobId("j-" + std::to_string(i)), spec);
  for (int i = 0; i < workers; ++i) scheduler.AddWorker(WorkerId(i), "avx2", 2);
  std::vector<GrantedLease> held = scheduler.GrantLeases(now);
  EXPECT_EQ(held.size(), static_cast<size_t>(workers) * 2);
  const double start = CpuSeconds();
  for (size_t i = 0; i < kDecisions; ++i) {
    GrantedLease& lease = held[i * 7919 % held.size()];
    scheduler.Heartbeat(lease.worker, {{lease.unit, lease.attempt}}, Attempt(0), now);
    EXPECT_EQ(scheduler.CompleteUnit(lease.worker, lease.unit, lease.attempt, now), Completion::kAccepted);
    scheduler.UnitCommitted(lease.unit);
    const std::vector<GrantedLease> granted = scheduler.GrantLeases(now);
    EXPECT_EQ(granted.size(), 1u);
    lease = granted.at(0);
    EXPECT_TRUE(scheduler.ExpireLeases(now).empty());
    EXPECT_GT(scheduler.NextExpiry(), now);
  }
  return CpuSeconds() - start;
}

TEST(SchedulerScale, ADecisionTakesAboutAsLongOnAFarmAHundredTimesAsLarge) {
  const double small = SecondsOfDecisions(/*workers=*/100, /*jobs=*/2);
  const double large = SecondsOfDecisions(/*workers=*/10'000, /*jobs=*/200);
  RecordProperty("ratio", std::to_string(large / small));
  EXPECT_LT(large, 20 * small);  // a linear search takes a thousand times as long
}

}  // namespace
}  // namespace lumifold::scheduler
