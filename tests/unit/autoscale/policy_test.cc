#include "client/autoscale/policy/policy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"

namespace lumifold::autoscale {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using State = Request::State;
using End = Request::End;

const absl::Time kStart = absl::UnixEpoch() + absl::Hours(24 * 365);

Request Worker(int id, State state, absl::Duration since = absl::ZeroDuration()) {
  Request request;
  request.id = absl::StrCat(id);
  request.worker_name = absl::StrCat("slurm-", id);
  request.state = state;
  if (state == State::kRunning) request.started = kStart - since;
  return request;
}

class PolicyTest : public testing::Test {
 protected:
  PolicyTest() {
    limits_.maximum = 10;
    tuning_.slots_per_worker = 4;
  }
  Decision Step(absl::Duration after = absl::ZeroDuration()) {
    return Decide(kStart + after, farm_, engine_, limits_, tuning_, &history_);
  }
  void Join(int id, FarmWorker::State state, double seconds_per_unit = 2) {
    farm_.workers.push_back({.id = absl::StrCat("w-", id),
                             .process = absl::StrCat("slurm-", id, "@node"),
                             .state = state,
                             .slots = 4,
                             .units_done = 10,
                             .seconds_per_unit = seconds_per_unit});
  }
  static std::vector<std::string> Ids(const Decision& decision) {
    std::vector<std::string> ids;
    for (const Release& release : decision.release) ids.push_back(release.id);
    return ids;
  }

  FarmState farm_;
  EngineState engine_;
  Limits limits_;
  Tuning tuning_;
  History history_;
};

TEST(AutoscaleBackoff, DoublesItsPausesFromTheFirstToTheLongest) {
  const Tuning tuning = {.pauses = {.first = absl::Seconds(3), .longest = absl::Seconds(20)}};
  Backoff backoff;
  EXPECT_EQ(backoff.NextTry(tuning), absl::InfinitePast());
  for (const int seconds : {3, 6, 12, 20, 20}) {
    backoff.Fail(kStart, "full");
    EXPECT_EQ(backoff.NextTry(tuning), kStart + absl::Seconds(seconds));
  }
}

TEST_F(PolicyTest, StartsNothingForAnEmptyQueueAndTheMinimumAlways) {
  EXPECT_EQ(Step().start, 0);
  limits_.minimum = 2;
  EXPECT_EQ(Step().start, 2);
}

TEST_F(PolicyTest, WantsAsManyWorkersAsFinishInTime) {
  farm_.users = {{.queued = 1200}};
  EXPECT_EQ(Step().wanted, 1);  // 1200 units of 2 s on 4 slots take 600 s
  farm_.users = {{.queued = 1201}};
  EXPECT_EQ(Step().wanted, 2);
  Join(7, FarmWorker::State::kBusy, 6);
  engine_.requests = {Worker(7, State::kRunning)};
  EXPECT_EQ(Step().wanted, 4);
}

TEST_F(PolicyTest, WantsNoMoreWorkersThanUnitsFill) {
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 9, .leased = 0}};
  EXPECT_EQ(Step().wanted, 3);
}

TEST_F(PolicyTest, CountsPendingRequestsAndStartsTheRest) {
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 20}};
  engine_.requests = {Worker(1, State::kPending), Worker(2, State::kRunning)};
  EXPECT_EQ(Step().start, 3);
  for (int i = 3; i < 6; ++i) engine_.requests.push_back(Worker(i, State::kPending));
  EXPECT_EQ(Step().start, 0);
}

TEST_F(PolicyTest, KeepsToTheMaximumAndToThatOfAUser) {
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 1000}, {.queued = 4}};
  EXPECT_EQ(Step().start, 10);
  limits_.per_user = 3;
  EXPECT_EQ(Step().start, 4);
  tuning_.starts_at_a_time = 2;
  EXPECT_EQ(Step().start, 2);
}

TEST_F(PolicyTest, CountsWorkersFromElsewhere) {
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 16}};
  farm_.workers = {{.process = "desk:12", .slots = 8}};
  EXPECT_EQ(Step().wanted, 2);
  EXPECT_THAT(Step().reason, HasSubstr("1 workers from elsewhere"));
  // "slurm-1" is not the worker of request 12.
  engine_.requests = {Worker(1, State::kRunning)};
  farm_.workers = {{.process = "slurm-12@node", .slots = 8}};
  EXPECT_EQ(Step().wanted, 2);
}

TEST_F(PolicyTest, ReleasesIdleWorkersAfterATimeAndNoBusyOnes) {
  engine_.requests = {Worker(1, State::kRunning), Worker(2, State::kRunning), Worker(3, State::kRunning)};
  Join(1, FarmWorker::State::kIdle);
  Join(2, FarmWorker::State::kBusy);
  Join(3, FarmWorker::State::kIdle);
  farm_.users = {{.leased = 1}};
  EXPECT_THAT(Ids(Step()), IsEmpty());
  EXPECT_THAT(Ids(Step(absl::Seconds(119))), IsEmpty());
  EXPECT_THAT(Ids(Step(absl::Seconds(120))), ElementsAre("1", "3"));
  limits_.minimum = 2;
  EXPECT_THAT(Ids(Step(absl::Seconds(120))), ElementsAre("1"));
}

TEST_F(PolicyTest, AUnitBeginsTheIdleTimeAgain) {
  engine_.requests = {Worker(1, State::kRunning)};
  Join(1, FarmWorker::State::kIdle);
  Step();
  farm_.workers[0].state = FarmWorker::State::kBusy;
  Step(absl::Seconds(60));
  farm_.workers[0].state = FarmWorker::State::kIdle;
  EXPECT_THAT(Ids(Step(absl::Seconds(125))), IsEmpty());
  EXPECT_THAT(Ids(Step(absl::Seconds(245))), ElementsAre("1"));
}

TEST_F(PolicyTest, CancelsPendingRequestsThatNobodyNeedsAndDuplicates) {
  engine_.requests = {Worker(1, State::kPending), Worker(2, State::kPending)};
  farm_.users = {{.queued = 1}};
  EXPECT_EQ(Ids(Step()).size(), 1u);
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 8}};
  engine_.requests[1].duplicate = true;
  const Decision decision = Step();
  EXPECT_THAT(Ids(decision), ElementsAre("2"));
  EXPECT_EQ(decision.start, 1);
}

TEST_F(PolicyTest, ReleasesBlockedWorkersAndThoseThatNeverJoin) {
  engine_.requests = {Worker(1, State::kRunning), Worker(2, State::kRunning)};
  Join(1, FarmWorker::State::kUseless);
  EXPECT_THAT(Ids(Step()), ElementsAre("1"));
  EXPECT_THAT(Ids(Step(absl::Minutes(10))), ElementsAre("1", "2"));
  EXPECT_EQ(history_.deaths.failures, 1);
}

TEST_F(PolicyTest, KeepsWorkersWhoseNamesTellNoRequest) {
  engine_.requests = {Worker(1, State::kRunning)};
  farm_.workers = {{.process = "some-name", .state = FarmWorker::State::kBusy}};
  farm_.users = {{.queued = 100, .leased = 4}};
  Step();
  EXPECT_THAT(Ids(Step(absl::Minutes(20))), IsEmpty());
}

TEST_F(PolicyTest, BacksOffAfterRefusalsAndTriesOneThen) {
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 40}};
  OnRefused(kStart, "no such partition", &history_);
  EXPECT_EQ(Step(absl::Seconds(9)).start, 0);
  EXPECT_THAT(Step(absl::Seconds(9)).reason, HasSubstr("no such partition (1 in a row); next try in 1s"));
  EXPECT_EQ(Step(absl::Seconds(10)).start, 1);
  OnRefused(kStart + absl::Seconds(10), "no such partition", &history_);
  EXPECT_EQ(Step(absl::Seconds(29)).start, 0);
  EXPECT_EQ(Step(absl::Seconds(30)).start, 1);
  OnStarted(&history_);
  EXPECT_EQ(Step(absl::Seconds(30)).start, 10);
}

TEST_F(PolicyTest, BacksOffAfterDeathsUntilAWorkerLives) {
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 40}};
  for (int i = 0; i < 3; ++i) {
    Request dead = Worker(i, State::kEnded);
    dead.end = End::kFailed;
    dead.started = kStart - absl::Seconds(3);
    dead.ended = kStart - absl::Seconds(1);
    dead.detail = "FAILED, NonZeroExitCode";
    engine_.requests.push_back(dead);
  }
  const Decision decision = Step();
  EXPECT_EQ(decision.start, 0);
  EXPECT_THAT(decision.reason, HasSubstr("workers die at their start"));
  EXPECT_THAT(decision.reason, HasSubstr("NonZeroExitCode (and 2 more) (1 in a row)"));
  EXPECT_EQ(history_.deaths.failures, 1);
  EXPECT_EQ(Step(absl::Seconds(9)).start, 1);
  EXPECT_EQ(history_.deaths.failures, 1) << "each end counts once";

  engine_.requests.push_back(Worker(4, State::kRunning, absl::Seconds(-10)));
  EXPECT_EQ(Step(absl::Seconds(20)).start, 0) << "the one that is tried may still die";
  EXPECT_EQ(Step(absl::Seconds(41)).start, 9);
  EXPECT_EQ(history_.deaths.failures, 0);
}

TEST_F(PolicyTest, WhatWasTakenReleasedOrLeftIsNoDeath) {
  for (const End end : {End::kTaken, End::kReleased, End::kLeft}) {
    Request gone = Worker(1, State::kRunning, absl::Seconds(5));
    engine_.requests = {gone};
    Join(1, FarmWorker::State::kBusy);
    Step();
    farm_.workers.clear();
    gone.state = State::kEnded;
    gone.end = end;
    gone.ended = kStart;
    engine_.requests = {gone};
    Step(absl::Seconds(1));
    EXPECT_EQ(history_.deaths.failures, 0);
    history_ = History();
  }
}

TEST_F(PolicyTest, AWorkerThatLeavesBeforeItJoinedHasDied) {
  Request gone = Worker(1, State::kEnded);
  gone.end = End::kLeft;
  gone.started = kStart - absl::Seconds(2);
  gone.ended = kStart;
  engine_.requests = {gone};
  Step();
  EXPECT_EQ(history_.deaths.failures, 1);
}

TEST_F(PolicyTest, CountsCoreHoursOfWorkersThatRunEndedAndVanished) {
  limits_.budget_core_hours = 100;
  Request running = Worker(1, State::kRunning, absl::Hours(1));
  running.cores = 2;
  Request ended = Worker(2, State::kEnded);
  ended.started = kStart - absl::Hours(3);
  ended.ended = kStart - absl::Hours(2);
  engine_.requests = {running, ended};
  Step();
  EXPECT_DOUBLE_EQ(history_.UsedCoreSeconds(), 3 * 3600);
  Step();
  EXPECT_DOUBLE_EQ(history_.UsedCoreSeconds(), 3 * 3600) << "nothing counts twice";
  engine_.requests.clear();
  Step(absl::Hours(1));
  EXPECT_DOUBLE_EQ(history_.UsedCoreSeconds(), 5 * 3600) << "a vanished worker is charged until now";
  Step(absl::Hours(2));
  EXPECT_DOUBLE_EQ(history_.UsedCoreSeconds(), 5 * 3600);
}

TEST_F(PolicyTest, ASpentBudgetReleasesAllAndAPeriodBeginsItAgain) {
  limits_.budget_core_hours = 1;
  limits_.budget_period = absl::Hours(24);
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 40}};
  engine_.requests = {Worker(1, State::kRunning), Worker(2, State::kPending)};
  Join(1, FarmWorker::State::kBusy);
  const Decision decision = Step(absl::Hours(1));
  EXPECT_THAT(Ids(decision), ElementsAre("1", "2"));
  EXPECT_EQ(decision.start, 0);
  EXPECT_THAT(decision.reason, HasSubstr("the budget of 1 core-hours is spent"));
  engine_.requests.clear();
  farm_.workers.clear();
  EXPECT_EQ(Step(absl::Hours(2)).start, 0);
  EXPECT_GT(Step(absl::Hours(24)).start, 0);
}

TEST_F(PolicyTest, StartsNoMoreThanTheBudgetLetsRun) {
  limits_.budget_core_hours = 0.25;  // three workers of one core for five minutes
  tuning_.finish_within = absl::Seconds(1);
  farm_.users = {{.queued = 40}};
  EXPECT_EQ(Step().start, 3);
}

}  // namespace
}  // namespace lumifold::autoscale
