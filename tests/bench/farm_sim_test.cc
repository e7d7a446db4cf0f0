// A short simulation with the promises of docs/scale.md.
#include <gtest/gtest.h>

#include "tests/bench/farm_sim.h"
#include "tests/bench/finish_sim.h"

namespace lumifold::sim {
namespace {

/// A tenth of the large farm, with all its troubles.
FarmSettings Small() {
  FarmSettings settings;
  settings.workers = 500;
  settings.jobs = 60;
  settings.units = 40'000;
  settings.high_priority = 10;
  return settings;
}

TEST(FarmSim, TheFarmIsBusyFairAndStarvesNobody) {
  const FarmResult result = Simulate(Small());
  ASSERT_TRUE(result.finished);
  EXPECT_LE(result.last_leased, 1.05 * result.ideal);
  EXPECT_LE(result.makespan, 1.10 * (result.ideal + result.longest_unit))
      << "a second lease may be unlucky too";
  EXPECT_LE(result.unfairness, 0.10);
  EXPECT_LE(result.longest_wait, absl::Minutes(2));
  EXPECT_GT(result.deaths, 0);
  EXPECT_GT(result.second_leases, 0);
}

TEST(FarmSim, TheSameSeedPlaysTheSameFarm) {
  FarmSettings settings = Small();
  settings.units = 5'000;
  const FarmResult first = Simulate(settings);
  const FarmResult second = Simulate(settings);
  EXPECT_EQ(first.makespan, second.makespan);
  EXPECT_EQ(first.leases, second.leases);
}

TEST(FarmSim, AuditsFindTheFaultyWorkersAndTheirUnitsAreRenderedAgain) {
  FarmSettings settings = Small();
  settings.audit_share = 0.5;
  settings.liars = 5;
  settings.units = 20'000;
  settings.frames_per_job = 1;
  const FarmResult result = Simulate(settings);
  ASSERT_TRUE(result.finished);
  EXPECT_EQ(result.faulty_found, 5);
  EXPECT_GT(result.units_redone, 0);
}

TEST(FinishSim, WorkersThatFinishGrowTheFarmPastItsCoordinator) {
  for (const int workers : {1, 2, 4, 8, 16}) {
    const FinishResult result = SimulateFinishing({.workers = workers});
    EXPECT_GE(result.share, 0.95) << workers;
  }
  const FinishResult alone = SimulateFinishing({.workers = 16, .workers_finish = false, .processes = 1});
  EXPECT_LE(alone.share, 0.15);
  const FinishResult many = SimulateFinishing({.workers = 64, .render_seconds = 41.6});
  EXPECT_GE(many.share, 0.95);
  EXPECT_GT(many.finished_by_workers, 0.9);
}

}  // namespace
}  // namespace lumifold::sim
