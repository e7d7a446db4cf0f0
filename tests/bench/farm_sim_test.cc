// A short simulation with the promises of docs/scale.md.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <utility>

#include "tests/bench/evidence_farm.h"
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
  settings.workers = 100;
  settings.units = 5'000;
  const FarmResult first = Simulate(settings);
  const FarmResult second = Simulate(settings);
  EXPECT_EQ(first.makespan, second.makespan);
  EXPECT_EQ(first.leases, second.leases);
}

TEST(FarmSim, AuditsFindTheFaultyWorkersAndTheirUnitsAreRenderedAgain) {
  FarmSettings settings = Small();
  settings.audit_share = 0.5;
  settings.bad_machines = 5;
  settings.units = 20'000;
  settings.frames_per_job = 1;
  const FarmResult result = Simulate(settings);
  ASSERT_TRUE(result.finished);
  EXPECT_EQ(result.faulty_found, 5);
  EXPECT_GT(result.units_redone, 0);
}

// The evidence rule of docs/decisions/0014-leases.md, over a queue of jobs.

struct EvidenceCase {
  FarmSettings settings = EvidenceFarm();
  FarmResult Run() {
    settings.units = 2'000;
    return Simulate(settings);
  }
};

TEST(Evidence, ABadMachineFailsNoJobThatAnotherOneRenders) {
  for (const auto& [misdeed, name] : kMisdeeds) {
    for (const absl::Duration alone : {absl::ZeroDuration(), AloneFor(misdeed)}) {
      EvidenceCase farm;
      farm.settings.bad_machines = 1;
      farm.settings.misdeed = misdeed;
      farm.settings.alone = alone;
      const FarmResult result = farm.Run();
      ASSERT_TRUE(result.finished) << name << " alone for " << alone;
      EXPECT_EQ(result.innocent_failed, 0) << name << " alone for " << alone;
      EXPECT_GT(result.spoiled_by_machines, 0) << name;
      // It costs the farm itself, and the last units' second leases.
      EXPECT_LE(result.makespan - alone, 1.35 * result.ideal) << name << " alone for " << alone;
    }
  }
}

TEST(Evidence, ALoneBadMachineIsNamedWithinAMinute) {
  for (const auto& [misdeed, expected] :
       {std::pair{Misdeed::kFailsAll, "second_opinion"}, std::pair{Misdeed::kFailsSlowly, "failures|backoff"},
        std::pair{Misdeed::kDies, "losses"}, std::pair{Misdeed::kHangs, "no_progress"}}) {
    EvidenceCase farm;
    farm.settings.bad_machines = 1;
    farm.settings.misdeed = misdeed;
    farm.settings.alone = absl::Minutes(2);
    EXPECT_THAT(farm.Run().reasons, ::testing::ContainsRegex(expected));
  }
}

TEST(Evidence, AMachineThatLiesIsFoundOnceOthersCanCompare) {
  EvidenceCase farm;
  farm.settings.bad_machines = 1;
  farm.settings.misdeed = Misdeed::kLies;
  farm.settings.audit_share = 0.3;
  EXPECT_EQ(farm.Run().faulty_found, 1);
}

TEST(Evidence, ABadJobCostsAWaveOfLeases) {
  for (const BadJob badness : {BadJob::kFails, BadJob::kCrashes}) {
    EvidenceCase farm;
    farm.settings.bad_jobs = 1;
    farm.settings.badness = badness;
    const FarmResult result = farm.Run();
    ASSERT_TRUE(result.finished);
    EXPECT_EQ(result.bad_failed, 1);
    EXPECT_EQ(result.innocent_failed, 0);
    const int slots = farm.settings.workers * farm.settings.slots;
    if (badness == BadJob::kFails) {
      EXPECT_LE(result.spoiled_by_jobs, slots + 2);
    }
    EXPECT_LE(result.workers_ended, 2 * farm.settings.workers);
  }
}

TEST(FinishSim, AWorkerThatFailsAllFramesCostsItself) {
  const FinishResult good = SimulateFinishing({.workers = 8});
  const FinishResult bad = SimulateFinishing({.workers = 8, .failing_workers = 1});
  EXPECT_GE(bad.frames_per_hour, 0.9 * good.frames_per_hour);
  EXPECT_GT(bad.failures, 0);
  // Each time it has as many as it has threads.
  EXPECT_LE(bad.failures, 2 * (bad.seconds / 300 + 1));
}

TEST(FinishSim, WorkersThatFinishGrowTheFarmPastItsCoordinator) {
  for (const int workers : {1, 2, 4, 8, 16, 44}) {
    const FinishResult result = SimulateFinishing({.workers = workers});
    EXPECT_GE(result.share, 0.95) << workers;
  }
  const FinishResult alone = SimulateFinishing({.workers = 16, .workers_finish = false, .processes = 1});
  EXPECT_LE(alone.share, 0.15);
  const FinishResult many = SimulateFinishing({.workers = 64, .render_seconds = 41.6});
  EXPECT_GE(many.share, 0.95);
  EXPECT_GT(many.finished_by_workers, 0.9);
}

TEST(FinishSim, WorkersThatKeepFramesGrowItFurtherAndSmallFarmsLoseNothing) {
  for (const double render_seconds : {8.5, 41.6}) {
    for (const int workers : {1, 2, 4, 8, 16, 64}) {
      FinishSettings settings = {.workers = workers, .render_seconds = render_seconds};
      const FinishResult travelling = SimulateFinishing(settings);
      settings.workers_keep = true;
      const FinishResult kept = SimulateFinishing(settings);
      EXPECT_GE(kept.share, 0.95) << workers;
      EXPECT_GE(kept.share, 0.93 * travelling.share) << workers;
    }
  }
}

}  // namespace
}  // namespace lumifold::sim
