#include <gtest/gtest.h>

#include <algorithm>

#include "tests/bench/autoscale_sim.h"

namespace lumifold::sim {
namespace {

TEST(AutoscaleSimulation, NeverHasMoreThanTheMaximumAndNeverStartsWhatIsPending) {
  for (const AutoscaleCase& scenario : AutoscaleCases()) {
    SCOPED_TRACE(scenario.name);
    const AutoscaleResult result = Simulate(scenario);
    EXPECT_LE(result.most_active, scenario.limits.maximum);
    EXPECT_LE(result.most_needless, 0);
  }
}

TEST(AutoscaleSimulation, DrainsABurstAndLetsAllWorkersGo) {
  const AutoscaleCase scenario = AutoscaleCaseNamed("burst");
  const AutoscaleResult result = Simulate(scenario);
  EXPECT_EQ(result.units_done, 4000);
  // What is asked for at the first look finishes within finish_within; then come a pause and a start of the
  // others once the time of a unit is known, which is three times what was assumed.
  const double ideal = absl::ToDoubleSeconds(scenario.tuning.finish_within);
  EXPECT_LE(result.last_done, 1.5 * ideal);
  EXPECT_EQ(result.busy_released, 0);
  EXPECT_GT(result.gone_after, result.last_done);
  EXPECT_LE(result.gone_after, result.last_done + absl::ToInt64Seconds(scenario.tuning.idle) + 30);
}

TEST(AutoscaleSimulation, FollowsARampUpAndDown) {
  const AutoscaleResult result = Simulate(AutoscaleCaseNamed("ramp"));
  EXPECT_EQ(result.units_done, 4800);
  EXPECT_LE(result.last_done, 1200 + 900);
  EXPECT_EQ(result.busy_released, 0);
  EXPECT_GT(result.gone_after, 0);
}

TEST(AutoscaleSimulation, TriesAnEngineThatRefusesRarely) {
  const AutoscaleResult result = Simulate(AutoscaleCaseNamed("refused"));
  // Pauses of 10, 20, 40 ... s fit seven times into 15 minutes.
  EXPECT_GE(result.refused, 3);
  EXPECT_LE(result.refused, 8);
  EXPECT_EQ(result.units_done, 2000);
  EXPECT_TRUE(std::any_of(result.samples.begin(), result.samples.end(), [](const AutoscaleSample& sample) {
    return sample.reason.find("the engine refused: sbatch") != std::string::npos &&
           sample.reason.find("next try in") != std::string::npos;
  }));
}

TEST(AutoscaleSimulation, StartsFewWorkersWhileTheyDie) {
  const AutoscaleCase scenario = AutoscaleCaseNamed("deaths");
  const AutoscaleResult result = Simulate(scenario);
  // The first batch, then one after each pause.
  const int first = result.samples[1].pending;
  EXPECT_GT(first, 0);
  EXPECT_LE(result.deaths, first + 8);
  EXPECT_EQ(result.units_done, 2000);
  EXPECT_TRUE(std::any_of(result.samples.begin(), result.samples.end(), [](const AutoscaleSample& sample) {
    return sample.reason.find("workers die at their start: request") != std::string::npos;
  }));
}

TEST(AutoscaleSimulation, ReplacesSpotMachinesAtOnce) {
  const AutoscaleCase scenario = AutoscaleCaseNamed("spot");
  const AutoscaleResult result = Simulate(scenario);
  EXPECT_EQ(result.units_done, 4000);
  for (const AutoscaleSample& sample : result.samples)
    EXPECT_EQ(sample.reason.find("die at their start"), std::string::npos) << sample.reason;
  // What is left after the second loss, at 600 s, takes finish_within again, and the start of its workers.
  EXPECT_LE(result.last_done, 600 + absl::ToInt64Seconds(scenario.tuning.finish_within) + 60);
}

TEST(AutoscaleSimulation, LeavesRequeuedWorkersToTheEngine) {
  const AutoscaleResult result = Simulate(AutoscaleCaseNamed("requeue"));
  EXPECT_EQ(result.units_done, 4000);
  EXPECT_LE(result.starts, 20);
}

TEST(AutoscaleSimulation, KeepsToTheBudget) {
  const AutoscaleCase scenario = AutoscaleCaseNamed("budget");
  const AutoscaleResult result = Simulate(scenario);
  // A look is late by at most 15 s of 20 workers.
  EXPECT_LE(result.core_hours, scenario.limits.budget_core_hours + 20 * 15 / 3600.0);
  EXPECT_GE(result.core_hours, 0.9 * scenario.limits.budget_core_hours);
  EXPECT_LT(result.units_done, 19200);
  EXPECT_EQ(result.samples.back().running, 0);
}

}  // namespace
}  // namespace lumifold::sim
