// The parts of the farm's state, each alone.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

#include "server/coordinator/job_table.h"
#include "server/coordinator/watchers.h"
#include "server/coordinator/worker_table.h"

namespace lumifold::server {
namespace {

using job::JobId;
using testing::ElementsAre;
using testing::IsEmpty;

const absl::Time kNow = absl::FromUnixSeconds(1000);

class CountingWatcher final : public JobWatcher {
 public:
  void OnStatus(const v1::JobStatus& status) override { statuses.push_back(status.job_id()); }
  void OnLost(const absl::Status& /*cause*/) override { ++lost; }

  std::vector<std::string> statuses;
  int lost = 0;
};

TEST(Watchers, AreToldOfTheirJobAtMostTenTimesASecond) {
  Watchers watchers;
  CountingWatcher one;
  CountingWatcher other;
  watchers.Add(&one, JobId("j-1"));
  watchers.Add(&other, JobId("j-2"));
  const auto notify = [&](absl::Time now) {
    watchers.Notify(now, [](const JobId& job) {
      v1::JobStatus status;
      status.set_job_id(job.value());
      return std::optional(status);
    });
  };
  EXPECT_EQ(watchers.due(), absl::InfiniteFuture());
  notify(kNow);
  EXPECT_THAT(one.statuses, IsEmpty());
  watchers.MarkChanged(JobId("j-1"));
  EXPECT_TRUE(watchers.TakeNews());
  EXPECT_FALSE(watchers.TakeNews());
  notify(kNow);
  EXPECT_THAT(one.statuses, ElementsAre("j-1"));
  EXPECT_THAT(other.statuses, IsEmpty());
  watchers.MarkChanged(JobId("j-1"));
  EXPECT_EQ(watchers.due(), kNow + absl::Milliseconds(100));
  notify(kNow + absl::Milliseconds(99));
  EXPECT_EQ(one.statuses.size(), 1);
  notify(kNow + absl::Milliseconds(100));
  EXPECT_EQ(one.statuses.size(), 2);
  watchers.NotifyEnd(JobId("j-1"), v1::JobStatus());
  watchers.NotifyEnd(JobId("j-2"), absl::UnavailableError("taken over"));
  EXPECT_EQ(one.statuses.size(), 3);
  EXPECT_EQ(one.lost, 0);
  EXPECT_EQ(other.lost, 1);
  watchers.Remove(&one);
  watchers.MarkChanged(JobId("j-1"));
  notify(kNow + absl::Seconds(1));
  EXPECT_EQ(one.statuses.size(), 3);
}

ledger::JobRecord RecordOf(const std::string& id, const std::string& user) {
  ledger::JobRecord record;
  record.id = JobId(id);
  record.scheduling.set_user(user);
  return record;
}

TEST(JobTable, CountsJobsThatHaveNotEnded) {
  JobTable jobs;
  jobs.Activate(RecordOf("j-1", "ann"));
  jobs.Activate(RecordOf("j-2", "bob"));
  v1::JobStatus shown;
  shown.mutable_scheduling()->set_user("ann");
  jobs.Suspend(JobId("j-3"), shown);
  EXPECT_EQ(jobs.CountOf("ann"), 2);
  std::optional<ActiveJob> active = jobs.TakeActive(JobId("j-1"));
  ASSERT_TRUE(active.has_value());
  jobs.AddEnding(JobId("j-1"), {.record = active->record, .shown = {}, .cancels = {}});
  EXPECT_EQ(jobs.CountOf("ann"), 1);
  EXPECT_TRUE(jobs.IsInMemory(JobId("j-1")));
  EXPECT_FALSE(jobs.TakeActive(JobId("j-1")).has_value());
  EXPECT_THAT(jobs.Ending(), ElementsAre(JobId("j-1")));
  jobs.TakeEnding(JobId("j-1"));
  EXPECT_FALSE(jobs.IsInMemory(JobId("j-1")));
  jobs.EndSuspension(JobId("j-3"));
  EXPECT_EQ(jobs.CountOf("ann"), 0);
}

TEST(JobTable, FindsTheJobsThatWaitForAFile) {
  JobTable jobs;
  for (const char* id : {"j-1", "j-2", "j-3"}) jobs.Activate(RecordOf(id, ""));
  jobs.FindActive(JobId("j-1"))->wanted_asset.emplace().set_sha256("a");
  jobs.FindActive(JobId("j-3"))->wanted_asset.emplace().set_sha256("a");
  jobs.FindActive(JobId("j-2"))->wanted_asset.emplace().set_sha256("b");
  EXPECT_THAT(jobs.WantedAssets(), ElementsAre("a", "b"));
  EXPECT_THAT(jobs.WaitingForAsset("a"), ElementsAre(JobId("j-1"), JobId("j-3")));
  EXPECT_THAT(jobs.WaitingForAsset("c"), IsEmpty());
}

TEST(SubmissionTable, CountsThoseThatRunWithTheJobs) {
  SubmissionTable submissions;
  EXPECT_TRUE(submissions.Begin("ann", 1, 3));
  EXPECT_TRUE(submissions.Begin("ann", 1, 3));
  EXPECT_FALSE(submissions.Begin("ann", 1, 3));
  EXPECT_TRUE(submissions.Begin("bob", 0, 1));
  submissions.End("ann");
  EXPECT_TRUE(submissions.Begin("ann", 1, 3));
  submissions.AddUncertain(JobId("j-1"));
  EXPECT_TRUE(submissions.IsUncertain(JobId("j-1")));
  EXPECT_TRUE(submissions.Forget(JobId("j-1")));
  EXPECT_FALSE(submissions.Forget(JobId("j-1")));
}

TEST(WorkerTable, NamesWorkersAlsoWhenTheyAreGone) {
  WorkerTable workers;
  const job::WorkerId first = workers.Add({.name = "node"});
  const job::WorkerId second = workers.Add({.name = "node"});
  EXPECT_NE(first, second);
  EXPECT_EQ(workers.NameOf(first), job::TextOf(first) + "/node");
  workers.Remove(first);
  EXPECT_EQ(workers.NameOf(first), job::TextOf(first));
  EXPECT_EQ(workers.Find(first), nullptr);
  workers.Acknowledge(first, {}, job::Attempt(1));  // no effect
  EXPECT_NE(workers.Add({.name = "node"}), first) << "ids are not used again";
}

}  // namespace
}  // namespace lumifold::server
