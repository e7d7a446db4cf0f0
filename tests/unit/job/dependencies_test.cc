#include "server/job/dependencies.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "absl/strings/str_cat.h"

namespace lumifold::job {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

const JobId kA("j-a"), kB("j-b"), kC("j-c"), kD("j-d");

std::vector<JobId> JobsOf(const Settled& settled) {
  std::vector<JobId> jobs;
  for (const HopelessJob& hopeless : settled.hopeless) jobs.push_back(hopeless.job);
  return jobs;
}

TEST(Dependencies, AJobStartsWhenAllThatItNamesAreDone) {
  Dependencies dependencies;
  EXPECT_THAT(dependencies.Add(kC, {{kA, v1::JOB_STATE_RUNNING}, {kB, v1::JOB_STATE_PAUSED}}).released,
              IsEmpty());
  EXPECT_TRUE(dependencies.IsWaiting(kC));
  EXPECT_THAT(dependencies.WaitsFor(kC), ElementsAre(kA, kB));
  EXPECT_THAT(dependencies.Ended(kB, v1::JOB_STATE_DONE).released, IsEmpty());
  EXPECT_THAT(dependencies.WaitsFor(kC), ElementsAre(kA));
  EXPECT_TRUE(dependencies.IsNamed(kB));
  EXPECT_THAT(dependencies.Ended(kA, v1::JOB_STATE_DONE).released, ElementsAre(kC));
  EXPECT_FALSE(dependencies.IsWaiting(kC));
  EXPECT_FALSE(dependencies.IsNamed(kB));
}

TEST(Dependencies, AJobWhoseListIsDoneNeverWaits) {
  Dependencies dependencies;
  EXPECT_THAT(dependencies.Add(kB, {{kA, v1::JOB_STATE_DONE}}).released, ElementsAre(kB));
  EXPECT_THAT(dependencies.Add(kC, {}).released, ElementsAre(kC));
}

TEST(Dependencies, JobsAreReleasedInTheOrderOfTheirSubmission) {
  Dependencies dependencies;
  for (const JobId& job : {kD, kB, kC}) dependencies.Add(job, {{kA, v1::JOB_STATE_RUNNING}});
  EXPECT_THAT(dependencies.Ended(kA, v1::JOB_STATE_DONE).released, ElementsAre(kD, kB, kC));
}

TEST(Dependencies, AFailureGoesDownTheWholeChainAndSaysWhy) {
  Dependencies dependencies;
  dependencies.Add(kB, {{kA, v1::JOB_STATE_RUNNING}});
  dependencies.Add(kC, {{kB, v1::JOB_STATE_SUBMITTED}, {kA, v1::JOB_STATE_RUNNING}});
  dependencies.Add(kD, {{kC, v1::JOB_STATE_SUBMITTED}});
  const Settled settled = dependencies.Ended(kA, v1::JOB_STATE_CANCELLED);
  EXPECT_THAT(settled.released, IsEmpty());
  EXPECT_THAT(JobsOf(settled), ElementsAre(kB, kC, kD));
  EXPECT_EQ(settled.hopeless[0].reason, "job j-a, which it waits for, was cancelled");
  EXPECT_EQ(settled.hopeless[2].reason, "job j-c, which it waits for, has failed");
  EXPECT_FALSE(dependencies.IsWaiting(kD));
  EXPECT_FALSE(dependencies.IsNamed(kA));
}

TEST(Dependencies, AJobThatNamesAFailedOrDeletedOneIsHopelessAtOnce) {
  Dependencies dependencies;
  const Settled failed = dependencies.Add(kB, {{kA, v1::JOB_STATE_FAILED}});
  ASSERT_EQ(failed.hopeless.size(), 1u);
  EXPECT_EQ(failed.hopeless[0].reason, "job j-a, which it waits for, has failed");
  const Settled deleted = dependencies.Add(kC, {{kD, v1::JOB_STATE_DONE}, {kA, v1::JOB_STATE_UNSPECIFIED}});
  ASSERT_EQ(deleted.hopeless.size(), 1u);
  EXPECT_EQ(deleted.hopeless[0].reason, "job j-a, which it waits for, was deleted");
  EXPECT_FALSE(dependencies.IsNamed(kD));
}

// After a restart nobody could tell whether a job that is gone had been done.
TEST(Dependencies, DeletingADoneJobEndsTheJobsThatStillNameIt) {
  Dependencies dependencies;
  dependencies.Add(kC, {{kA, v1::JOB_STATE_DONE}, {kB, v1::JOB_STATE_RUNNING}});
  EXPECT_THAT(JobsOf(dependencies.Deleted(kA)), ElementsAre(kC));
}

TEST(Dependencies, AJobThatRunsAgainIsWaitedForAgain) {
  Dependencies dependencies;
  dependencies.Add(kC, {{kA, v1::JOB_STATE_DONE}, {kB, v1::JOB_STATE_RUNNING}});
  dependencies.Reopened(kA);
  EXPECT_THAT(dependencies.Ended(kB, v1::JOB_STATE_DONE).released, IsEmpty());
  EXPECT_THAT(dependencies.Ended(kA, v1::JOB_STATE_DONE).released, ElementsAre(kC));
}

TEST(Dependencies, ACancelledJobNoLongerWaits) {
  Dependencies dependencies;
  dependencies.Add(kB, {{kA, v1::JOB_STATE_RUNNING}});
  dependencies.Ended(kB, v1::JOB_STATE_CANCELLED);
  EXPECT_FALSE(dependencies.IsWaiting(kB));
  EXPECT_THAT(dependencies.Ended(kA, v1::JOB_STATE_DONE).released, IsEmpty());
}

TEST(Dependencies, ALongChainEndsInOneCall) {
  Dependencies dependencies;
  constexpr int kJobs = 20'000;
  for (int i = 1; i < kJobs; ++i)
    dependencies.Add(JobId(absl::StrCat(i)), {{JobId(absl::StrCat(i - 1)), v1::JOB_STATE_SUBMITTED}});
  EXPECT_EQ(dependencies.Ended(JobId("0"), v1::JOB_STATE_FAILED).hopeless.size(), size_t{kJobs - 1});
}

// Any history: a restart, which adds the waiting jobs again with the states of that moment, changes nothing.
TEST(Dependencies, ARestartChangesNothing) {
  constexpr int kJobs = 30;
  for (uint32_t seed = 0; seed < 200; ++seed) {
    std::mt19937 random(seed);
    std::vector<std::vector<int>> after(kJobs);
    std::vector<v1::JobState> states(kJobs, v1::JOB_STATE_RUNNING);
    Dependencies dependencies;
    const auto id = [](int i) { return JobId(absl::StrCat("j-", 100 + i)); };
    const auto prerequisites = [&](int i) {
      std::vector<Prerequisite> list;
      for (const int other : after[static_cast<size_t>(i)])
        list.push_back({id(other), states[static_cast<size_t>(other)]});
      return list;
    };
    const auto apply = [&](const Settled& settled) {
      for (const JobId& job : settled.released)
        states[std::stoul(job.value().substr(2)) - 100] = v1::JOB_STATE_RUNNING;
      for (const HopelessJob& job : settled.hopeless)
        states[std::stoul(job.job.value().substr(2)) - 100] = v1::JOB_STATE_FAILED;
    };
    for (int i = 0; i < kJobs; ++i) {
      for (int k = 0; k < i; ++k)
        if (random() % 8 == 0) after[static_cast<size_t>(i)].push_back(k);
      states[static_cast<size_t>(i)] = v1::JOB_STATE_SUBMITTED;
      apply(dependencies.Add(id(i), prerequisites(i)));
    }
    for (int step = 0; step < 60; ++step) {
      const auto i = static_cast<size_t>(random() % kJobs);
      if (states[i] == v1::JOB_STATE_RUNNING) {
        states[i] = random() % 6 == 0 ? v1::JOB_STATE_FAILED : v1::JOB_STATE_DONE;
        apply(dependencies.Ended(id(static_cast<int>(i)), states[i]));
      } else if (states[i] == v1::JOB_STATE_DONE && random() % 4 == 0) {
        states[i] = v1::JOB_STATE_RUNNING;
        dependencies.Reopened(id(static_cast<int>(i)));
      }
      Dependencies restarted;
      for (int k = 0; k < kJobs; ++k) {
        if (states[static_cast<size_t>(k)] != v1::JOB_STATE_SUBMITTED) continue;
        const Settled settled = restarted.Add(id(k), prerequisites(k));
        ASSERT_THAT(settled.released, IsEmpty()) << "seed " << seed;
        ASSERT_THAT(settled.hopeless, IsEmpty()) << "seed " << seed;
        ASSERT_EQ(restarted.WaitsFor(id(k)), dependencies.WaitsFor(id(k))) << "seed " << seed;
      }
    }
  }
}

}  // namespace
}  // namespace lumifold::job
