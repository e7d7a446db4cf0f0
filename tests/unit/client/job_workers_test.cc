#include "client/farm/job_workers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"
#include "tests/unit/client/fake_farm.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;

v1::WorkerStatus Worker(const std::string& process, const std::string& job) {
  v1::WorkerStatus worker;
  worker.set_name("farm");
  worker.set_process(process);
  worker.set_state(v1::WORKER_STATE_BUSY);
  worker.set_slots(2);
  worker.set_leases(1);
  worker.add_job_ids(job);
  return worker;
}

TEST(WorkerLines, SayWhatTheWorkersOfTheJobDoByName) {
  v1::WorkerStatus old = Worker("b:2", "job-1");
  old.set_units_done(120);
  old.set_units_failed(3);
  old.set_seconds_per_unit(0.287);
  old.set_state(v1::WORKER_STATE_DRAINING);
  EXPECT_THAT(
      WorkerLines("job-1", {old, Worker("c:3", "job-2"), Worker("a:1", "job-1")}),
      ElementsAre("a:1                       1 of 2 units",
                  "b:2                       1 of 2 units, 0.29 s a unit, 120 done, 3 failed, draining"));
}

TEST(WorkerLines, AreNoMoreThanAScreenHolds) {
  std::vector<v1::WorkerStatus> workers;
  workers.reserve(kMaxWorkerLines + 5);
  for (int i = 0; i < kMaxWorkerLines + 5; ++i)
    workers.push_back(Worker(absl::StrCat("w:", 100 + i), "job-1"));
  const std::vector<std::string> lines = WorkerLines("job-1", workers);
  ASSERT_EQ(lines.size(), kMaxWorkerLines);
  EXPECT_EQ(lines.back(), "and 6 more workers");
  workers.resize(kMaxWorkerLines);
  EXPECT_NE(WorkerLines("job-1", workers).back(), "and 1 more workers");
}

TEST(JobWorkersTest, AsksForAllPagesOfTheFarm) {
  FakeFarm farm;
  const TestEnvironment test;
  FakeTime time;
  farm.workers = {Worker("a:1", "job-1"), Worker("b:2", "job-1")};
  const JobWorkers workers(ConnectTo({.coordinators = {farm.address()},
                                      .time = time.Environment(),
                                      .interrupted = test.environment.interrupted}),
                           "job-1");
  while (workers.Lines().empty()) absl::SleepFor(absl::Milliseconds(1));
  EXPECT_EQ(workers.Lines().size(), 2);
}

}  // namespace
}  // namespace lumifold::client
