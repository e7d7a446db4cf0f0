#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::JobId;
using job::UnitRef;
using job::WorkerId;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using SchedulerFailuresTest = SchedulerFixture;

TEST_F(SchedulerFailuresTest, AFailedUnitGoesToAnotherWorkerWhereThereIsOne) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease failed = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_TRUE(scheduler_.units().Fail(kAnn, failed.unit, failed.attempt, {}, kStart));
  scheduler_.ExpireLeases(kStart + absl::Seconds(1));  // the backoff is over
  EXPECT_NE(scheduler_.GrantLeases(kAnn, kStart).at(0).unit, failed.unit);
  EXPECT_EQ(scheduler_.GrantLeases(kBen, kStart).at(0).unit, failed.unit);
}

TEST_F(SchedulerFailuresTest, AWorkerThatFailedAUnitAndReconnectsIsStillTheSame) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.name = "bad", .numeric_class = "avx2", .slots = 1});
  scheduler_.workers().Add(kBen, {.name = "good", .numeric_class = "avx2", .slots = 1});
  const GrantedLease failed = scheduler_.GrantLeases(kAnn, kStart).at(0);
  scheduler_.units().Fail(kAnn, failed.unit, failed.attempt, {}, kStart);
  scheduler_.workers().Remove(kAnn);
  const WorkerId again(3);
  scheduler_.workers().Add(again, {.name = "bad", .numeric_class = "avx2", .slots = 1});
  scheduler_.ExpireLeases(kStart + absl::Seconds(1));  // the backoff is over
  EXPECT_NE(scheduler_.GrantLeases(again, kStart).at(0).unit, failed.unit);
  EXPECT_EQ(scheduler_.GrantLeases(kBen, kStart).at(0).unit, failed.unit);
}

TEST_F(SchedulerFailuresTest, ADroppedUnitGoesToAnotherWorkerWhereThereIsOne) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease first = scheduler_.GrantLeases(kAnn, kStart).at(0);
  const std::vector<LateLease> late = scheduler_.workers().Heartbeat(kAnn, {}, first.attempt, kStart);
  ASSERT_EQ(late.size(), 1u);
  EXPECT_EQ(late[0].unit, first.unit);
  EXPECT_EQ(late[0].lateness, Lateness::kDropped);
  const GrantedLease again = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(again.unit, first.unit) << "there is no other worker";
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 1});
  scheduler_.workers().Heartbeat(kAnn, {}, again.attempt, kStart);
  EXPECT_NE(scheduler_.GrantLeases(kAnn, kStart).at(0).unit, first.unit);
  EXPECT_EQ(scheduler_.GrantLeases(kBen, kStart).at(0).unit, first.unit);
}

TEST_F(SchedulerFailuresTest, AFailedUnitWaitsLongerAndLongerUntilItsWorkerCallsItImpossible) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 12});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  GrantedLease lease = leases[0];
  absl::Time now = kStart;
  for (const absl::Duration pause : {absl::Seconds(1), absl::Seconds(2)}) {
    EXPECT_TRUE(scheduler_.units().Fail(kAnn, lease.unit, lease.attempt, {}, now));
    EXPECT_FALSE(scheduler_.units().Fail(kAnn, lease.unit, lease.attempt, {}, now)) << "it has no lease";
    EXPECT_EQ(scheduler_.NextExpiry(), now + pause);
    scheduler_.ExpireLeases(now + pause - absl::Milliseconds(1));
    EXPECT_THAT(scheduler_.GrantLeases(now), IsEmpty());
    now += pause;
    scheduler_.ExpireLeases(now);
    const auto again = scheduler_.GrantLeases(now);
    ASSERT_EQ(again.size(), 1u);
    EXPECT_EQ(again[0].unit, lease.unit);
    lease = again[0];
  }
  scheduler_.units().Fail(kAnn, lease.unit, lease.attempt, {.error = "no memory"}, now);
  scheduler_.ExpireLeases(now + absl::Seconds(10));
  EXPECT_THAT(scheduler_.GrantLeases(now + absl::Seconds(10)), IsEmpty()) << "it is not asked again";
  EXPECT_THAT(scheduler_.Explain(kJob, now), Contains(testing::Field(&Reason::code, "second_opinion")));
}

TEST_F(SchedulerFailuresTest, AWorkerThatFailsWhatOthersRenderCoolsDownForAWhile) {
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  for (const JobId& job : {kJob, kOther}) {
    scheduler_.jobs().Add(job, Spec());
    const GrantedLease failed = scheduler_.GrantLeases(kAnn, kStart).at(0);
    if (job == kJob) scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 12});
    scheduler_.units().Fail(kAnn, failed.unit, failed.attempt, {.permanent = true}, kStart);
    EXPECT_EQ(scheduler_.workers().CoolDownReason(kAnn), "");
    for (const GrantedLease& lease : scheduler_.GrantLeases(kBen, kStart)) Commit(kBen, lease);
    if (job == kJob) {
      EXPECT_THAT(scheduler_.workers().TakeCooling(), IsEmpty()) << "one job may be at fault itself";
      scheduler_.jobs().End(job);
    }
  }
  const std::vector<CoolingWorker> aside = scheduler_.workers().TakeCooling();
  ASSERT_EQ(aside.size(), 1u);
  EXPECT_EQ(aside[0].worker, kAnn);
  EXPECT_EQ(aside[0].until, kStart + absl::Minutes(5));
  EXPECT_EQ(aside[0].reason, "it failed units of 2 jobs that other workers rendered");
  EXPECT_EQ(scheduler_.workers().CoolDownReason(kAnn), aside[0].reason);
  scheduler_.jobs().Add(kJob, Spec());
  EXPECT_THAT(scheduler_.GrantLeases(kAnn, kStart), IsEmpty());
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Minutes(5));
  scheduler_.ExpireLeases(kStart + absl::Minutes(5));
  EXPECT_EQ(scheduler_.workers().CoolDownReason(kAnn), "");
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart + absl::Minutes(5)).size(), 1u);
}

TEST_F(SchedulerFailuresTest, AUnitThatCrashesWorkersRunsAloneAndThenItsJobFails) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(WorkerId(1), {.name = "host:1", .numeric_class = "avx2", .slots = 1});
  const UnitRef poison = GrantReceived().at(0).unit;
  for (int64_t i = 2; i <= 3; ++i) {
    scheduler_.workers().Remove(WorkerId(i - 1));
    scheduler_.workers().Add(WorkerId(i),
                             {.name = absl::StrCat("host:", i), .numeric_class = "avx2", .slots = 1});
    EXPECT_EQ(GrantReceived().at(0).unit, poison);
  }
  scheduler_.workers().Remove(WorkerId(3));
  scheduler_.workers().Add(WorkerId(4), {.name = "host:4", .numeric_class = "avx2", .slots = 3});
  scheduler_.workers().Add(WorkerId(5), {.name = "host:5", .numeric_class = "avx2", .slots = 2});
  const auto leases = GrantReceived();
  ASSERT_EQ(leases.size(), 3u);
  EXPECT_EQ(leases[0].unit, poison);
  EXPECT_EQ(leases[0].worker, WorkerId(4));
  EXPECT_TRUE(leases[0].alone);
  EXPECT_EQ(leases[1].worker, WorkerId(5)) << "the worker in quarantine gets nothing else";
  EXPECT_THAT(scheduler_.TakeFailedJobs(), IsEmpty());
  scheduler_.workers().Remove(WorkerId(4));
  const std::vector<FailedJob> failed = scheduler_.TakeFailedJobs();
  ASSERT_EQ(failed.size(), 1u);
  EXPECT_EQ(failed[0].job, kJob);
  EXPECT_THAT(failed[0].error, HasSubstr("j-1 frame 10 tile 0 geometry: workers were lost with it 4 times"));
  EXPECT_THAT(failed[0].error, HasSubstr("host:1, host:2, host:3, host:4"));
}

TEST_F(SchedulerFailuresTest, AUnitInQuarantineThatIsRenderedIsCommittedLikeAnyOther) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t i = 1; i <= 3; ++i) {
    scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2", .slots = 2});
    GrantReceived();
    scheduler_.workers().Remove(WorkerId(i));
  }
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 2});
  for (int i = 0; i < 2; ++i) {
    const auto alone = GrantReceived();
    ASSERT_EQ(alone.size(), 1u);
    EXPECT_TRUE(alone[0].alone);
    EXPECT_EQ(alone[0].unit.key.kind, i == 0 ? v1::UNIT_KIND_GEOMETRY : v1::UNIT_KIND_PASS);
    EXPECT_FALSE(Commit(kAnn, alone[0]));
  }
  const auto others = GrantReceived();
  ASSERT_EQ(others.size(), 2u);
  EXPECT_FALSE(others[0].alone);
}

TEST_F(SchedulerFailuresTest, AUnitInQuarantineThatStandsStillGoesToASecondWorker) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t i = 1; i <= 3; ++i) {
    scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2", .slots = 1});
    GrantReceived();
    scheduler_.workers().Remove(WorkerId(i));
  }
  scheduler_.workers().Add(kAnn, {.name = "ann", .numeric_class = "avx2", .slots = 1});
  const auto first = GrantReceived();
  ASSERT_EQ(first.size(), 1u);
  ASSERT_TRUE(first[0].alone);
  const HeldLease hangs{first[0].unit, first[0].attempt, 0};
  absl::Time now = kStart + absl::Seconds(29);
  scheduler_.workers().Heartbeat(kAnn, {hangs}, first[0].attempt, now);
  EXPECT_THAT(scheduler_.ExpireLeases(now), IsEmpty());
  now += absl::Seconds(1);
  ASSERT_EQ(scheduler_.ExpireLeases(now).size(), 1u);
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "avx2", .slots = 1});
  const auto second = scheduler_.GrantLeases(now);
  ASSERT_EQ(second.size(), 1u);
  EXPECT_EQ(second[0].unit, first[0].unit);
  EXPECT_TRUE(second[0].alone);
  EXPECT_TRUE(scheduler_.units().HoldsLease(kAnn, first[0].unit, first[0].attempt))
      << "the first result counts";
  EXPECT_EQ(scheduler_.units().Complete(kBen, second[0].unit, second[0].attempt, now), Completion::kAccepted);
  EXPECT_FALSE(scheduler_.units().HoldsLease(kAnn, first[0].unit, first[0].attempt));
}

TEST_F(SchedulerFailuresTest, AUnitInQuarantineWaitsUntilItsWorkerIsIdle) {
  scheduler_.jobs().Add(kOther, Spec());
  scheduler_.workers().Add(WorkerId(9), {.numeric_class = "avx2", .slots = 2});
  const GrantedLease busy = GrantReceived().at(0);
  for (int64_t i = 1; i <= 3; ++i) {
    scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2", .slots = 1});
    GrantReceived();
    scheduler_.workers().Remove(WorkerId(i));
  }
  scheduler_.jobs().Add(kJob, Spec());
  Commit(WorkerId(9), busy);  // one slot is free, the other one is not
  EXPECT_THAT(GrantReceived(), IsEmpty());
  scheduler_.jobs().End(kOther);
  EXPECT_EQ(GrantReceived().size(), 2u) << "the unit in quarantine has ended with its job";
}

TEST_F(SchedulerFailuresTest, AWorkerThatIsLostWithItsUnitAgainAndAgainCountsAsSeveral) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t i = 1; i <= 6; ++i) {
    scheduler_.workers().Add(WorkerId(i), {.name = "restarted", .numeric_class = "avx2", .slots = 1});
    EXPECT_FALSE(GrantReceived().at(0).alone);
    scheduler_.workers().Remove(WorkerId(i));
  }
  scheduler_.workers().Add(WorkerId(7), {.name = "restarted", .numeric_class = "avx2", .slots = 1});
  EXPECT_TRUE(GrantReceived().at(0).alone);
}

TEST_F(SchedulerFailuresTest, AWorkerThatComesBackWasNotEndedByItsUnit) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t i = 1; i <= 20; ++i) {
    scheduler_.workers().Add(WorkerId(i),
                             {.name = "one", .numeric_class = "avx2", .instance = 7, .slots = 1});
    EXPECT_FALSE(GrantReceived().at(0).alone);
    scheduler_.workers().Remove(WorkerId(i));
  }
}

TEST_F(SchedulerFailuresTest, NorWasOneThatWasSilentForAWhile) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.name = "one", .numeric_class = "avx2", .instance = 7, .slots = 1});
  absl::Time now = kStart;
  for (int i = 0; i < 20; ++i) {
    const std::vector<GrantedLease> leases = scheduler_.GrantLeases(now);
    ASSERT_EQ(leases.size(), 1u);
    EXPECT_FALSE(leases[0].alone);
    now += absl::Minutes(1);
    EXPECT_EQ(scheduler_.ExpireLeases(now).size(), 1u);
    EXPECT_THAT(scheduler_.workers().Heartbeat(kAnn, {}, leases[0].attempt, now), IsEmpty());
  }
}

TEST_F(SchedulerFailuresTest, AWorkerThatIsGoneBeforeItHasTheLeaseProvesNothing) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t i = 1; i <= 20; ++i) {  // as when the coordinator stood still while they were killed
    scheduler_.workers().Add(WorkerId(i), {.name = absl::StrCat(i), .numeric_class = "avx2", .slots = 1});
    EXPECT_FALSE(scheduler_.GrantLeases(kStart).at(0).alone);
    scheduler_.workers().Remove(WorkerId(i));
  }
  EXPECT_THAT(scheduler_.TakeFailedJobs(), IsEmpty());
}

TEST_F(SchedulerFailuresTest, AUnitLeavesTheQuarantineWhenWhatWasLostWithItComesBack) {
  scheduler_.jobs().Add(kJob, Spec());
  const auto traits = [](uint64_t instance) {
    return WorkerTraits{
        .name = absl::StrCat("host:", instance), .numeric_class = "avx2", .instance = instance, .slots = 1};
  };
  for (uint64_t i = 1; i <= 3; ++i) {
    scheduler_.workers().Add(WorkerId(static_cast<int64_t>(i)), traits(i));
    GrantReceived();
    scheduler_.workers().Remove(WorkerId(static_cast<int64_t>(i)));
  }
  scheduler_.jobs().Pause(kJob);
  scheduler_.workers().Add(WorkerId(4), traits(9));
  scheduler_.jobs().Resume(kJob);
  EXPECT_THAT(scheduler_.Explain(kJob, kStart), Contains(testing::Field(&Reason::code, "quarantine")));
  scheduler_.workers().Add(WorkerId(5), traits(2));
  const std::vector<GrantedLease> leases = GrantReceived();
  ASSERT_EQ(leases.size(), 2u);
  EXPECT_FALSE(leases[0].alone);
  EXPECT_FALSE(leases[1].alone);
}

TEST_F(SchedulerFailuresTest, AnEarlierConnectionOfTheProcessLosesItsLeases) {
  scheduler_.jobs().Add(kJob, Spec());
  const WorkerTraits traits{.name = "one", .numeric_class = "avx2", .instance = 7, .slots = 4};
  scheduler_.workers().Add(kAnn, traits);
  const std::vector<GrantedLease> before = GrantReceived();
  Commit(kAnn, before.at(0));
  scheduler_.workers().Add(kBen, traits);  // the end of its first connection is not known yet
  const std::vector<GrantedLease> after = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(after.size(), 4u);
  for (size_t i = 0; i < 3; ++i) {
    const GrantedLease& lost = before[i + 1];
    EXPECT_EQ(scheduler_.units().Complete(kAnn, lost.unit, lost.attempt, kStart), Completion::kStale);
    EXPECT_EQ(after[i].unit, lost.unit);
    EXPECT_EQ(after[i].worker, kBen);
  }
  EXPECT_NE(after[3].unit, before[0].unit) << "it is committed";
  scheduler_.workers().Remove(kAnn);
  for (const GrantedLease& lease : after)
    EXPECT_TRUE(scheduler_.units().HoldsLease(kBen, lease.unit, lease.attempt));
}

TEST_F(SchedulerFailuresTest, AnInstanceOfAnotherNameIsAnotherProcess) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.name = "one", .numeric_class = "avx2", .instance = 7, .slots = 4});
  const std::vector<GrantedLease> before = GrantReceived();
  scheduler_.workers().Add(kBen, {.name = "two", .numeric_class = "avx2", .instance = 7, .slots = 4});
  for (const GrantedLease& lease : before)
    EXPECT_TRUE(scheduler_.units().HoldsLease(kAnn, lease.unit, lease.attempt));
}

TEST_F(SchedulerFailuresTest, ConnectionsThatBreakAgainAndAgainAreNoLosses) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t i = 1; i <= 20; ++i) {  // as losses, these would put the unit into quarantine
    scheduler_.workers().Add(WorkerId(i),
                             {.name = "one", .numeric_class = "avx2", .instance = 7, .slots = 1});
    EXPECT_FALSE(GrantReceived().at(0).alone);
    // Half of them before the next one connects, half of them after.
    if (i % 2 == 1) continue;
    scheduler_.workers().Remove(WorkerId(i));
    scheduler_.workers().Remove(WorkerId(i - 1));
  }
}

TEST(SchedulerLosses, EachWayInWhichAWorkerIsLostMakesItsUnitSuspectAndNoOther) {
  const auto held = [](const GrantedLease& lease) {
    return std::vector<HeldLease>{{.unit = lease.unit, .attempt = lease.attempt}};
  };
  struct Way {
    const char* name;
    bool is_loss;  // of a lease that the worker had received
    bool is_loss_unreceived;
    std::function<void(Scheduler&, const GrantedLease&, absl::Time now)> end;
  };
  const std::vector<Way> ways = {
      {"silent", true, false,
       [](Scheduler& s, const GrantedLease&, absl::Time now) { s.ExpireLeases(now + absl::Seconds(30)); }},
      {"stalled", true, true,
       [&](Scheduler& s, const GrantedLease& lease, absl::Time now) {
         s.workers().Heartbeat(lease.worker, held(lease), lease.attempt, now + absl::Seconds(20));
         s.ExpireLeases(now + absl::Seconds(40));
       }},
      {"not named any more", true, true,
       [](Scheduler& s, const GrantedLease& lease, absl::Time now) {
         s.workers().Heartbeat(lease.worker, {}, lease.attempt, now);
       }},
      {"gone", true, false,
       [](Scheduler& s, const GrantedLease& lease, absl::Time) { s.workers().Remove(lease.worker); }},
      {"handed back", false, false, [](Scheduler& s, const GrantedLease& lease, absl::Time) {
         s.units().HandBack(lease.worker, lease.unit, lease.attempt);
       }}};
  for (const Way& way : ways) {
    for (const bool is_received : {true, false}) {
      Scheduler scheduler({.lease = absl::Seconds(30), .stall = absl::Seconds(40)});
      scheduler.jobs().Add(kJob, RowSpec(1));
      absl::Time now = kStart;
      bool is_suspect = false;
      for (int i = 1; i <= 8 && !is_suspect; ++i, now += absl::Minutes(1)) {
        const std::string name = absl::StrCat("w", i);
        const job::WorkerId worker(i);
        scheduler.workers().Add(worker, {.name = name, .party = name, .numeric_class = "avx2", .slots = 1});
        const std::vector<GrantedLease> granted = scheduler.GrantLeases(now);
        ASSERT_EQ(granted.size(), 1u) << way.name << " " << i;
        const GrantedLease& lease = granted[0];
        is_suspect = lease.alone;
        if (is_received) scheduler.workers().Heartbeat(worker, held(lease), job::Attempt(0), now);
        way.end(scheduler, lease, now);
        scheduler.workers().Drain(worker);
      }
      EXPECT_EQ(is_suspect, is_received ? way.is_loss : way.is_loss_unreceived) << way.name;
    }
  }
}

}  // namespace
}  // namespace lumifold::scheduler
