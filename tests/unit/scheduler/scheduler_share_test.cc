// Who gets a lease: shares, locality, waiting, idle slots.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::JobId;
using job::WorkerId;
using ::testing::IsEmpty;

class SchedulerShareTest : public ::testing::Test {
 protected:
  Scheduler scheduler_{{}};
  absl::Time now_ = kStart;

  void Commit(const GrantedLease& lease) {
    EXPECT_EQ(scheduler_.units().Complete(lease.worker, lease.unit, lease.attempt, now_),
              Completion::kAccepted);
    scheduler_.units().Commit(lease.unit);
  }

  /// Renders `count` units of one second each on the one worker; returns the jobs in order.
  std::vector<JobId> Render(WorkerId worker, int count) {
    std::vector<JobId> jobs;
    for (int i = 0; i < count; ++i) {
      const GrantedLease lease = scheduler_.GrantLeases(worker, now_).at(0);
      jobs.push_back(lease.unit.job);
      now_ += absl::Seconds(1);
      Commit(lease);
    }
    return jobs;
  }
};

TEST_F(SchedulerShareTest, UsersGetEqualSlotsAtOnce) {
  for (int i = 0; i < 4; ++i)
    scheduler_.jobs().Add(JobId(absl::StrCat("a-", i)), RowSpec(500), {.user = "ann"});
  scheduler_.jobs().Add(JobId("b"), RowSpec(500), {.user = "ben"});
  scheduler_.jobs().Add(JobId("c"), RowSpec(500), {.priority = 10, .user = "cat"});
  for (int i = 0; i < 80; ++i) scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2"});
  std::map<std::string, int> leases;
  for (const GrantedLease& lease : scheduler_.GrantLeases(now_))
    ++leases[lease.unit.job.value().substr(0, 1)];
  EXPECT_EQ(leases["a"], 20);
  EXPECT_EQ(leases["b"], 20);
  EXPECT_EQ(leases["c"], 40);
}

TEST_F(SchedulerShareTest, JobsOfAUserEndInTheOrderOfSubmission) {
  std::map<std::string, std::vector<double>> ends;  // by user; in units of the whole time
  std::vector<JobId> jobs;
  for (const char* job : {"ann-1", "ann-2", "ben-1", "ann-3", "cat-1", "cat-2", "ben-2", "cat-3", "ben-3",
                          "ann-4", "ben-4", "cat-4"}) {
    jobs.emplace_back(job);
    scheduler_.jobs().Add(jobs.back(), RowSpec(50), {.user = jobs.back().value().substr(0, 3)});  // 100 units
  }
  constexpr int slots = 8;
  for (int i = 0; i < slots; ++i) scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2"});
  while (!jobs.empty()) {
    const std::vector<GrantedLease> leases = scheduler_.GrantLeases(now_);
    ASSERT_EQ(leases.size(), slots) << "no slot is idle";
    now_ += absl::Seconds(10);
    for (const GrantedLease& lease : leases) Commit(lease);
    std::erase_if(jobs, [&](const JobId& job) {
      if (scheduler_.jobs().Progress(job).units_done < 100) return false;
      std::vector<double>& of_user = ends[job.value().substr(0, 3)];
      of_user.push_back(absl::ToDoubleSeconds(now_ - kStart) / (1200 * 10 / slots));
      EXPECT_EQ(job.value().substr(4), absl::StrCat(of_user.size()));
      return true;
    });
  }
  double mean = 0;
  for (const auto& [user, times] : ends) {
    ASSERT_EQ(times.size(), 4u);
    for (size_t i = 0; i < times.size(); ++i) {
      EXPECT_NEAR(times[i], 0.25 * static_cast<double>(i + 1), 0.06) << user;
      mean += times[i] / 12;
    }
  }
  EXPECT_LT(mean, 0.65) << "with equal shares for a user's jobs it is .87";
}

TEST_F(SchedulerShareTest, AWorkerGoesOnWithTheSceneItHasLoadedUntilTheSlackIsUsedUp) {
  scheduler_.jobs().Add(kJob, RowSpec(500), {.user = "ann"});
  scheduler_.jobs().Add(kOther, RowSpec(500), {.user = "ben"});
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2"});
  const std::vector<JobId> jobs = Render(kAnn, 600);
  int changes = 0;
  std::map<JobId, int> units;
  for (size_t i = 0; i < jobs.size(); ++i) {
    ++units[jobs[i]];
    if (i > 0 && jobs[i] != jobs[i - 1]) ++changes;
  }
  EXPECT_GE(changes, 3);
  EXPECT_LE(changes, 10) << "one for each minute of slack";
  EXPECT_NEAR(units[kJob], 300, 70);
}

TEST_F(SchedulerShareTest, LongUnitsCountWhileTheyRun) {
  scheduler_.jobs().Add(kJob, RowSpec(20'000), {.user = "ann"});
  scheduler_.jobs().Add(kOther, RowSpec(20'000), {.user = "ben"});
  for (int i = 0; i < 20; ++i) scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2"});
  std::map<JobId, int> held;
  std::vector<GrantedLease> short_units;
  const auto grant = [&] {
    for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) {
      ++held[lease.unit.job];
      if (lease.unit.job == kOther) short_units.push_back(lease);
    }
  };
  grant();
  for (int i = 0; i < 600; ++i) {  // the units of kOther take a second, those of kJob do not end
    now_ += absl::Seconds(1);
    for (const GrantedLease& lease : std::exchange(short_units, {})) {
      Commit(lease);
      --held[kOther];
    }
    grant();
    for (const GrantedLease& lease : short_units) EXPECT_EQ(lease.unit.job, kOther);
  }
  EXPECT_LE(held[kJob], 14) << "short units must not lose all slots to long ones";
  EXPECT_GE(held[kOther], 6);
}

TEST_F(SchedulerShareTest, AJobOfTheLowestPriorityDoesNotStarve) {
  scheduler_.jobs().Add(kJob, RowSpec(20'000), {.priority = 100, .user = "ann"});
  scheduler_.jobs().Add(kOther, RowSpec(500), {.priority = -100, .user = "ben"});
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2"});
  absl::Time served = now_;
  absl::Duration longest;
  for (int i = 0; i < 5000; ++i) {
    const JobId job = Render(kAnn, 1).front();
    if (job != kOther) continue;
    longest = std::max(longest, now_ - served);
    served = now_;
  }
  longest = std::max(longest, now_ - served);
  EXPECT_LE(longest, absl::Minutes(11));
}

TEST_F(SchedulerShareTest, IdleSlotsTakeLateUnitsASecondTimeAndOnlyOnce) {
  scheduler_.jobs().Add(kJob, RowSpec(10));  // 20 units
  for (int i = 0; i < 20; ++i) scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2"});
  const auto leases = scheduler_.GrantLeases(now_);
  ASSERT_EQ(leases.size(), 20u);
  now_ += absl::Seconds(2);
  for (size_t i = 0; i < leases.size(); ++i) {
    if (i != 5 && i != 15) Commit(leases[i]);  // a geometry unit and a pass
  }
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty());
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(3)) << "1.5 times the mean";
  now_ = kStart + absl::Seconds(3);
  EXPECT_THAT(scheduler_.ExpireLeases(now_), IsEmpty()) << "they are not overdue";
  const auto second = scheduler_.GrantLeases(now_);
  ASSERT_EQ(second.size(), 2u);
  for (const GrantedLease& lease : second) {
    EXPECT_TRUE(lease.unit == leases[5].unit || lease.unit == leases[15].unit);
    EXPECT_NE(lease.worker, lease.unit == leases[5].unit ? leases[5].worker : leases[15].worker);
  }
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty());
  Commit(second[0]);
  const auto revoked = scheduler_.units().TakeRevoked();
  ASSERT_EQ(revoked.size(), 1u);
  EXPECT_EQ(revoked[0].unit, second[0].unit);
  now_ = kStart + absl::Seconds(20);  // it is overdue as well
  scheduler_.ExpireLeases(now_);
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty()) << "no third lease";
}

TEST_F(SchedulerShareTest, APausedOrLimitedJobGetsNoSecondLeases) {
  scheduler_.jobs().Add(kJob, RowSpec(10), {.max_leases = 20});
  for (int i = 0; i < 30; ++i) scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2"});
  const auto leases = scheduler_.GrantLeases(now_);
  now_ += absl::Seconds(2);
  for (size_t i = 0; i < 9; ++i) Commit(leases[2 * i]);  // geometry and pass of one tile after another
  scheduler_.jobs().Pause(kJob);
  now_ += absl::Seconds(4);
  scheduler_.ExpireLeases(now_);
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty());
  scheduler_.jobs().Resume(kJob);
  EXPECT_EQ(scheduler_.GrantLeases(now_).size(), 1u) << "the tenth geometry unit; no pass has ended";
}

TEST_F(SchedulerShareTest, AJobMovedToTheFrontComesFirstAmongItsUsersJobs) {
  for (const char* job : {"a-1", "a-2", "a-3", "b-1"})
    scheduler_.jobs().Add(JobId(job), RowSpec(500), {.user = std::string(job).substr(0, 1)});
  scheduler_.jobs().Add(JobId("a-high"), RowSpec(500), {.priority = 10, .turn = -5, .user = "a"});
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 20});
  EXPECT_EQ(scheduler_.jobs().TurnOfFirst(JobId("a-3")), 0);
  EXPECT_EQ(scheduler_.jobs().TurnOfFirst(JobId("a-high")), -5);
  scheduler_.jobs().SetTurn(JobId("a-3"), -1);
  EXPECT_EQ(scheduler_.jobs().TurnOfFirst(JobId("a-1")), -1);
  std::map<std::string, int> leases;
  for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) ++leases[lease.unit.job.value()];
  EXPECT_EQ(leases["a-1"] + leases["a-2"], 0);
  EXPECT_GT(leases["a-3"], 0);
  const std::vector<Reason> reasons = scheduler_.Explain(JobId("a-2"), now_);
  ASSERT_EQ(reasons.size(), 2u);
  EXPECT_EQ(reasons[1].code, "turn");
  EXPECT_EQ(reasons[1].text, "2 jobs of its user with the same priority come first, the next is a-3");
  EXPECT_EQ(scheduler_.Explain(JobId("a-3"), now_).size(), 1u);
}

}  // namespace
}  // namespace lumifold::scheduler
