#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>

#include "server/child/child_task.h"
#include "server/finish/estimate_round.h"
#include "server/finish/frame_finisher.h"
#include "tests/unit/server/committed_frame_fixture.h"

namespace lumifold::server {
namespace {

using job::JobId;
using ::testing::HasSubstr;

const JobId kJob("j-1");
const ledger::OwnedJob kOwned = {kJob, {}};

class ChildProcessFinisherTest : public CommittedFrameFixture {
 protected:
  ChildProcessFinisherTest() { Commit(kJob, Spec(20, 12)); }

  std::unique_ptr<FrameFinisher> Child(ChildProcessOptions options = {}) const {
    if (options.program == ChildProcessOptions().program) options.program = LUMIFOLD_SERVER_PROGRAM;
    return MakeChildProcessFinisher(folder_, options);
  }
};

TEST_F(ChildProcessFinisherTest, WritesTheSameFileAsTheFinisherWithin) {
  ASSERT_TRUE(MakeInProcessFinisher(folder_, store_.get(), [] { return absl::Now(); })
                  ->Finish(kOwned, 0, 2, {}, nullptr)
                  .ok());
  const std::string expected = Result(kJob);
  ASSERT_FALSE(expected.empty());
  ASSERT_TRUE(RemoveAll(folder_.ResultsPath(kJob)).ok());
  const absl::StatusOr<v1::FrameReport> report = Child()->Finish(kOwned, 0, 1, {}, nullptr);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_GT(report->times().filter_seconds(), 0.0);
  EXPECT_EQ(Result(kJob), expected);
}

TEST_F(ChildProcessFinisherTest, TellsHowFarTheFilterOfTheChildIs) {
  for (const bool is_child : {true, false}) {
    std::vector<double> shares;
    const std::unique_ptr<FrameFinisher> finisher =
        is_child ? Child() : MakeInProcessFinisher(folder_, store_.get(), [] { return absl::Now(); });
    const absl::StatusOr<v1::FrameReport> report =
        finisher->Finish(kOwned, 0, 1, {}, [&](double share) { shares.push_back(share); });
    ASSERT_TRUE(report.ok()) << report.status();
    ASSERT_FALSE(shares.empty());
    EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
    EXPECT_GT(shares.front(), 0);
    EXPECT_LE(shares.back(), 1);
  }
}

TEST_F(ChildProcessFinisherTest, TellsWhatTheChildTells) {
  const absl::Status status = Child()->Finish({JobId("j-none"), {}}, 0, 1, {}, nullptr).status();
  EXPECT_EQ(status, absl::NotFoundError("no job j-none"));
}

TEST_F(ChildProcessFinisherTest, ADamagedRecordIsNamed) {
  const std::string path = folder_.PathOf(folder_.UnitLogName(kJob, 0));
  std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
  const int byte = file.seekg(5000).peek();
  file.seekp(5000).put(static_cast<char>(byte ^ 1));
  file.close();
  const absl::Status status = Child()->Finish(kOwned, 0, 1, {}, nullptr).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), HasSubstr(path));
  EXPECT_EQ(Result(kJob), "");
}

TEST_F(ChildProcessFinisherTest, AChildWithoutMemoryIsAnErrorAndNoCrash) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "the address sanitizer needs more address space than any limit";
#else
  EXPECT_FALSE(Child({.memory_limit_bytes = 1 << 20})->Finish(kOwned, 0, 1, {}, nullptr).ok());
#endif
}

TEST_F(ChildProcessFinisherTest, AChildWithoutProgramIsAnErrorAndNoCrash) {
  EXPECT_THAT(
      std::string(Child({.program = "/none/such"})->Finish(kOwned, 0, 1, {}, nullptr).status().message()),
      HasSubstr("/none/such"));
}

/// A program that answers with its arguments and the store in its environment.
std::string Echo(const TempFolder& folder) {
  std::string path = folder.PathOf("child");
  std::ofstream(path)
      << "#!/bin/sh\nprintf '=13 arguments %s, store %s' \"$*\" \"$LUMIFOLD_STORE\"; exit 1\n";
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

TEST_F(ChildProcessFinisherTest, AChildIsToldWhatItIsToDo) {
  const std::unique_ptr<FrameFinisher> finisher =
      Child({.program = Echo(temp_), .store = "s", .memory_limit_bytes = 1 << 20});
  RoundToEstimate round = {.job = kJob,
                           .epoch = ledger::Epoch(7),
                           .frame = 4,
                           .round = 2,
                           .rendered = absl::Milliseconds(1500),
                           .samples = 64};
  const std::string common = "arguments finish-frame " + folder_.root() + " 3 1048576  j-1 4 ";
  EXPECT_EQ(finisher->Estimate(round, 3).status().message(), common + "2 1500 64 7 -1   urgent, store s");
  round.filtered = absl::Milliseconds(2250);
  EXPECT_EQ(finisher->Estimate(round, 3).status().message(), common + "2 1500 64 7 -1  2.25 urgent, store s");
  EXPECT_EQ(finisher->Finish({kJob, ledger::Epoch(7)}, 4, 3, {5, 0}, nullptr).status().message(),
            common + "-1 0 0 7 -1 5,0  , store s");
  EXPECT_EQ(finisher->Filter({kJob, ledger::Epoch(7)}, 4, 2, 3).status().message(),
            common + "-1 0 0 7 2   , store s");
}

TEST_F(ChildProcessFinisherTest, AnEstimateGoesByTheTimeThatTheJobHasTaken) {
  const JobId job("j-2");
  v1::JobSpec spec = Spec(20, 12);
  spec.set_samples_per_pixel(400);
  spec.set_pass_samples(64);
  spec.mutable_adaptive()->set_time_seconds(60);
  const job::FrameRounds rounds(spec);
  Commit(job, spec, /*is_forward=*/true,
         [&](const job::UnitKey& key) { return key.pass <= 1 && rounds.Has(key); });
  const absl::StatusOr<v1::FrameReport> report = Child()->Estimate(
      {.job = job, .epoch = {}, .round = 1, .rendered = absl::Milliseconds(2500), .samples = 20 * 12 * 48},
      1);
  ASSERT_TRUE(report.ok()) << report.status();
  const absl::StatusOr<job::FrameRounds> estimated = ReadRounds(folder_, job, spec, 0);
  ASSERT_TRUE(estimated.ok()) << estimated.status();
  EXPECT_EQ(estimated->estimated(), 2);
  EXPECT_EQ(estimated->rendered_seconds(), 2.5);
  ASSERT_EQ(estimated->schedule().size(), 1u);
  EXPECT_EQ(estimated->schedule()[0], 400) << "48 samples took a twentieth of the time";
}

TEST_F(ChildProcessFinisherTest, TheNameOfTheStoreIsInTheEnvironmentOfTheChildAndNotInItsArguments) {
  const absl::Status status = Child({.program = Echo(temp_), .store = "postgresql://u:secret@h/db"})
                                  ->Finish(kOwned, 0, 1, {}, nullptr)
                                  .status();
  const std::string message(status.message());
  EXPECT_THAT(message, HasSubstr(", store postgresql://u:secret@h/db"));
  EXPECT_EQ(message.substr(0, message.find(", store")).find("secret"), std::string::npos);
}

TEST_F(ChildProcessFinisherTest, TheChildYieldsToOtherProcessesButIsNotStarved) {
  static_assert(kChildNiceness <= 5);
  const int expected = std::max(getpriority(PRIO_PROCESS, 0), kChildNiceness);
  EXPECT_EXIT(
      {
        RunFinishFrameProcess({folder_.root(), "1", "0", "j-none", "0", "-1", "0", "0", "1", ""});
        _exit(getpriority(PRIO_PROCESS, 0));
      },
      testing::ExitedWithCode(expected), "");
}

TEST_F(ChildProcessFinisherTest, AnEstimateThatWorkersWaitForDoesNotYield) {
  const int expected = std::max(getpriority(PRIO_PROCESS, 0), 0);
  EXPECT_EXIT(
      {
        RunFinishFrameProcess({folder_.root(), "1", "0", "j-none", "0", "1", "0", "0", "1", kUrgent});
        _exit(getpriority(PRIO_PROCESS, 0));
      },
      testing::ExitedWithCode(expected), "");
}

TEST_F(ChildProcessFinisherTest, TheFinisherWithinKeepsThePriorityOfItsProcess) {
  const int before = getpriority(PRIO_PROCESS, 0);
  ASSERT_TRUE(MakeInProcessFinisher(folder_, store_.get(), [] { return absl::Now(); })
                  ->Finish(kOwned, 0, 2, {}, nullptr)
                  .ok());
  EXPECT_EQ(getpriority(PRIO_PROCESS, 0), before);
}

/// A program that runs for a minute instead of filtering.
std::string Sleeper(const TempFolder& folder) {
  std::string path = folder.PathOf("sleeper");
  std::ofstream(path) << "#!/bin/sh\nexec sleep 60\n";
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

TEST_F(ChildProcessFinisherTest, AChildThatRunsTooLongIsKilled) {
  const absl::Time start = absl::Now();
  const absl::Status status = Child({.program = Sleeper(temp_), .time_limit = absl::Milliseconds(100)})
                                  ->Finish(kOwned, 0, 1, {}, nullptr)
                                  .status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_THAT(std::string(status.message()), HasSubstr("frame 0 ran longer than 100ms"));
  EXPECT_FALSE(IsWorthRetrying(status));
  EXPECT_LT(absl::Now() - start, absl::Seconds(30));
}

TEST_F(ChildProcessFinisherTest, TheEndOfItsJobKillsAChildAndOfNoOther) {
  const std::unique_ptr<FrameFinisher> finisher = Child({.program = Sleeper(temp_)});
  std::atomic<bool> has_ended{false};
  std::thread canceller([&] {
    while (!has_ended) {
      finisher->CancelJob(JobId("j-other"));
      finisher->CancelJob(kJob);
      absl::SleepFor(absl::Milliseconds(10));
    }
  });
  EXPECT_EQ(finisher->Finish(kOwned, 0, 1, {}, nullptr).status(), absl::CancelledError("the job has ended"));
  has_ended = true;
  canceller.join();
  finisher->CancelJob(kJob);  // no effect on later calls
  EXPECT_TRUE(Child()->Finish(kOwned, 0, 1, {}, nullptr).ok());
}

TEST_F(ChildProcessFinisherTest, AKilledChildIsWorthRetrying) {
  const std::string path = temp_.PathOf("suicide");
  std::ofstream(path) << "#!/bin/sh\nkill -9 $$\n";
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  const absl::Status status = Child({.program = path})->Finish(kOwned, 0, 1, {}, nullptr).status();
  EXPECT_THAT(std::string(status.message()), HasSubstr("ended by signal 9"));
  EXPECT_TRUE(IsWorthRetrying(status));
}

TEST_F(ChildProcessFinisherTest, AChildThatEndsWithoutAnAnswerIsAnErrorHoweverFarItWas) {
  const std::string path = temp_.PathOf("silent");
  for (const std::string text : {"", "\\201\\300\\344"}) {
    std::ofstream(path) << "#!/bin/sh\nprintf '" << text << "'\n";
    std::filesystem::permissions(path, std::filesystem::perms::owner_all);
    std::vector<double> shares;
    const absl::Status status = Child({.program = path})
                                    ->Finish(kOwned, 0, 1, {}, [&](double share) { shares.push_back(share); })
                                    .status();
    EXPECT_THAT(std::string(status.message()), HasSubstr("ended with code 0 and no answer"));
    EXPECT_EQ(shares.empty() ? 0 : shares.back(), text.empty() ? 0 : 1);
  }
}

TEST_F(ChildProcessFinisherTest, AfterCancelNothingStarts) {
  const std::unique_ptr<FrameFinisher> finisher = Child();
  finisher->Cancel();
  EXPECT_EQ(finisher->Finish(kOwned, 0, 1, {}, nullptr).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(Result(kJob), "");
}

}  // namespace
}  // namespace lumifold::server
