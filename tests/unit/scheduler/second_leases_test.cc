#include "server/scheduler/second_leases.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "tests/unit/scheduler/unit_names.h"

namespace lumifold::scheduler {
namespace {

using job::Attempt;
using ::testing::ElementsAre;

constexpr SecondLeases::Kind kGeometry{7, 0};
constexpr SecondLeases::Kind kPasses{7, 2};
constexpr double kUsual = 1;
const Requirement kAny{};
const Requirement kSse2{"sse2", {}};

class SecondLeasesTest : public ::testing::Test {
 protected:
  /// The mean of the passes is then 10 s.
  void MakeMeanKnown() {
    for (int i = 0; i < 8; ++i) second_.CountTime(kPasses, absl::Seconds(i % 2 == 0 ? 5 : 15));
  }
  static Lease Granted() {
    Lease lease;
    lease.granted = kNow;
    lease.progressed = kNow;
    return lease;
  }
  /// The leases that Take looks at for a worker of this kind, in this order, without taking any.
  std::vector<Attempt> SeenBy(const Requirement& kind) {
    std::vector<Attempt> seen;
    EXPECT_FALSE(second_.Take(kind, [&](Attempt attempt) {
      seen.push_back(attempt);
      return SecondLeases::Use::kKeep;
    }));
    return seen;
  }

  SecondLeases second_{{.lease = absl::Seconds(20),
                        .overdue_factor = 4,
                        .overdue_least = absl::Seconds(30),
                        .late_factor = 1.5}};
};

TEST_F(SecondLeasesTest, TheMeanIsKnownFromTheEighthUnitOfItsKind) {
  for (int i = 0; i < 7; ++i) EXPECT_FALSE(second_.CountTime(kPasses, absl::Seconds(10)));
  EXPECT_FALSE(second_.CountTime(kGeometry, absl::Seconds(1))) << "of another kind";
  EXPECT_FALSE(second_.CountTime({8, 2}, absl::Seconds(1))) << "of another job";
  EXPECT_FALSE(second_.MeanOf(kPasses).has_value());
  EXPECT_EQ(second_.OverdueTime(kPasses, kNow), absl::InfiniteFuture());
  EXPECT_TRUE(second_.CountTime(kPasses, absl::Seconds(26)));
  EXPECT_EQ(second_.MeanOf(kPasses), absl::Seconds(12));
  EXPECT_FALSE(second_.CountTime(kPasses, absl::Seconds(12))) << "it was known before";
  EXPECT_FALSE(second_.MeanOf(kGeometry).has_value());
  second_.ForgetTimes(7);
  EXPECT_FALSE(second_.MeanOf(kPasses).has_value());
}

TEST_F(SecondLeasesTest, ALeaseIsFirstLateAndThenOverdue) {
  MakeMeanKnown();
  Lease lease = Granted();
  second_.Schedule(kPasses, kUsual, &lease);
  EXPECT_EQ(lease.check, kNow + absl::Seconds(15));
  EXPECT_FALSE(second_.MarkLate(kPasses, kUsual, lease.check - absl::Nanoseconds(1), &lease));
  EXPECT_TRUE(second_.MarkLate(kPasses, kUsual, kNow + absl::Seconds(15), &lease));
  EXPECT_EQ(lease.expected_end, kNow + absl::Seconds(30)) << "twice what it has taken";
  EXPECT_EQ(lease.check, kNow + absl::Seconds(40)) << "four times the mean, more than the least";
  EXPECT_FALSE(second_.MarkLate(kPasses, kUsual, kNow + absl::Seconds(16), &lease)) << "it is late already";
  EXPECT_FALSE(second_.MarkOverdue(kPasses, lease.check - absl::Nanoseconds(1), &lease));
  EXPECT_TRUE(second_.MarkOverdue(kPasses, kNow + absl::Seconds(40), &lease));
  EXPECT_EQ(lease.check, absl::InfiniteFuture());
}

TEST_F(SecondLeasesTest, WithoutAMeanALeaseIsLateWhenItStandsStill) {
  Lease lease = Granted();
  second_.Schedule(kPasses, kUsual, &lease);
  EXPECT_EQ(lease.check, kNow + absl::Seconds(20));
  lease.progressed = kNow + absl::Seconds(7);
  EXPECT_FALSE(second_.MarkLate(kPasses, kUsual, lease.check, &lease));
  EXPECT_EQ(lease.check, kNow + absl::Seconds(27));
  EXPECT_TRUE(second_.MarkLate(kPasses, kUsual, lease.check, &lease));
  EXPECT_TRUE(second_.IsWorthwhile(lease, kPasses, 10, kNow + absl::Seconds(27)));
  EXPECT_FALSE(second_.MarkOverdue(kPasses, kNow + absl::Hours(1), &lease))
      << "nobody knows how long it takes";
}

TEST_F(SecondLeasesTest, AMeanThatHasRisenPutsTheLimitOff) {
  MakeMeanKnown();
  Lease lease = Granted();
  second_.Schedule(kPasses, kUsual, &lease);
  const absl::Time check = lease.check;
  for (int i = 0; i < 8; ++i) second_.CountTime(kPasses, absl::Seconds(30));
  EXPECT_FALSE(second_.MarkLate(kPasses, kUsual, check, &lease));
  EXPECT_EQ(lease.check, kNow + absl::Seconds(30)) << "1.5 times the new mean";
}

TEST_F(SecondLeasesTest, ASlowWorkersLeaseIsLateAtOnce) {
  MakeMeanKnown();
  EXPECT_EQ(second_.LateTime(kPasses, 1.19, Granted()), kNow + absl::Seconds(15));
  EXPECT_EQ(second_.LateTime(kPasses, 1.2, Granted()), kNow + absl::Milliseconds(200));
}

TEST_F(SecondLeasesTest, ShortUnitsHaveTheLeastLimits) {
  for (int i = 0; i < 8; ++i) second_.CountTime(kGeometry, absl::Milliseconds(10));
  EXPECT_EQ(second_.LateTime(kGeometry, kUsual, Granted()), kNow + absl::Milliseconds(200));
  EXPECT_EQ(second_.OverdueTime(kGeometry, kNow), kNow + absl::Seconds(30));
}

TEST_F(SecondLeasesTest, AuditsAndUnitsInQuarantineAreOverdueOnlyAndOnce) {
  for (const bool mean_is_known : {false, true}) {
    if (mean_is_known) MakeMeanKnown();
    for (bool Lease::* reason : {&Lease::alone, &Lease::audit}) {
      Lease lease = Granted();
      lease.progressed = kNow + absl::Seconds(1);
      lease.*reason = true;
      second_.Schedule(kPasses, kUsual, &lease);
      const absl::Time overdue =
          mean_is_known ? second_.OverdueTime(kPasses, kNow) : lease.progressed + absl::Seconds(20);
      EXPECT_EQ(lease.check, overdue);
      EXPECT_FALSE(second_.MarkOnlyOverdue(kPasses, overdue - absl::Seconds(1), &lease));
      EXPECT_TRUE(second_.MarkOnlyOverdue(kPasses, overdue, &lease));
      EXPECT_FALSE(second_.MarkOnlyOverdue(kPasses, overdue + absl::Hours(1), &lease));
      second_.Schedule(kPasses, kUsual, &lease);
      EXPECT_EQ(lease.check, absl::InfiniteFuture());
    }
  }
}

TEST_F(SecondLeasesTest, ASecondLeaseIsWorthwhileIfItEndsEarlier) {
  MakeMeanKnown();
  Lease late = Granted();
  const absl::Time now = kNow + absl::Seconds(15);
  ASSERT_TRUE(second_.MarkLate(kPasses, kUsual, now, &late));  // expected to end 15 s from now
  EXPECT_TRUE(second_.IsWorthwhile(late, kPasses, 1.4, now));
  EXPECT_FALSE(second_.IsWorthwhile(late, kPasses, 1.5, now)) << "no earlier";
  const absl::Time later = kNow + absl::Seconds(40);
  EXPECT_TRUE(second_.IsWorthwhile(late, kPasses, 1.9, later)) << "it should have ended: half as long again";
  EXPECT_FALSE(second_.IsWorthwhile(late, kPasses, 2, later));
}

TEST_F(SecondLeasesTest, SlownessIsTheMeanOfTheLastSixteenUnits) {
  Worker worker;
  SecondLeases::Rate(absl::Seconds(20), absl::Seconds(10), &worker);
  EXPECT_DOUBLE_EQ(worker.slowness, 2) << "time by mean; the first unit replaces the guess";
  SecondLeases::Rate(absl::Seconds(10), absl::Seconds(10), &worker);
  EXPECT_DOUBLE_EQ(worker.slowness, 1.5);
  for (int i = 0; i < 20; ++i) SecondLeases::Rate(absl::Seconds(10), absl::Seconds(10), &worker);
  EXPECT_EQ(worker.rated, 16);
  const double before = worker.slowness;
  SecondLeases::Rate(absl::Seconds(20), absl::Seconds(10), &worker);
  EXPECT_DOUBLE_EQ(worker.slowness, before + (2 - before) / 16);
}

TEST_F(SecondLeasesTest, TheLeaseThatEndsLastIsTakenFirst) {
  second_.Enter(kAvx2, kNow + absl::Seconds(1), Attempt(1));
  second_.Enter(kAvx2, kNow + absl::Seconds(3), Attempt(2));
  second_.Enter(kAvx2, kNow + absl::Seconds(2), Attempt(3));
  EXPECT_THAT(SeenBy(kAvx2), ElementsAre(Attempt(2), Attempt(3), Attempt(1)));
  EXPECT_EQ(second_.Take(kAvx2, [](Attempt) { return SecondLeases::Use::kTake; }), Attempt(2));
  EXPECT_THAT(SeenBy(kAvx2), ElementsAre(Attempt(3), Attempt(1)));
  EXPECT_EQ(second_.Take(kAvx2,
                         [](Attempt attempt) {
                           return attempt == Attempt(3) ? SecondLeases::Use::kDrop : SecondLeases::Use::kTake;
                         }),
            Attempt(1));
  EXPECT_FALSE(second_.HasAny(kAvx2));
}

TEST_F(SecondLeasesTest, AWorkerSeesTheLeasesOfJobsThatItMayRender) {
  second_.Enter(kAvx2, kNow, Attempt(1));
  EXPECT_TRUE(second_.HasAny(kAvx2));
  EXPECT_FALSE(second_.HasAny(kSse2));
  EXPECT_THAT(SeenBy(kSse2), ElementsAre());
  second_.Enter(kAny, kNow, Attempt(2));
  EXPECT_THAT(SeenBy(kSse2), ElementsAre(Attempt(2)));
  EXPECT_THAT(SeenBy(kAvx2), ElementsAre(Attempt(2), Attempt(1)));
  second_.Remove(kAny, kNow, Attempt(1));  // is not there
  second_.Remove(kAvx2, kNow, Attempt(1));
  EXPECT_THAT(SeenBy(kAvx2), ElementsAre(Attempt(2)));
}

TEST_F(SecondLeasesTest, TakeLooksAt64LeasesOnly) {
  for (int i = 0; i < 70; ++i) second_.Enter(kAvx2, kNow + absl::Seconds(i), Attempt(i));
  EXPECT_EQ(SeenBy(kAvx2).size(), 64u);
  EXPECT_EQ(SeenBy(kAvx2).back(), Attempt(6));
}

}  // namespace
}  // namespace lumifold::scheduler
