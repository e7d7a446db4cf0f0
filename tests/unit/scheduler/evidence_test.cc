#include "server/scheduler/evidence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/scheduler/unit_names.h"

namespace lumifold::scheduler {
namespace {

using job::WorkerId;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr absl::Duration kExclusion = absl::Minutes(5);

Worker MakeWorker(const std::string& name, const std::string& party, uint64_t instance,
                  int64_t units_done = 0) {
  Worker worker;
  worker.traits.instance = instance;
  worker.traits.name = name;
  worker.traits.party = party;
  worker.units.done = units_done;
  return worker;
}

class EvidenceTest : public ::testing::Test {
 protected:
  const Evidence::Record& Fail(const UnitIndex& unit, int64_t id, const Worker& worker,
                               bool permanent = false) {
    return evidence_.AddFailure(unit, WorkerId(id), worker, permanent, "error of " + worker.traits.name,
                                kNow);
  }

  const Worker ann_ = MakeWorker("ann:1", "ann", 1);
  const Worker ann_again_ = MakeWorker("ann:2", "ann", 2);
  const Worker ben_ = MakeWorker("ben:1", "ben", 3, 5);
  Evidence evidence_{{.disputes = {.max_failures = 3}, .cool_down = kExclusion}};
};

TEST_F(EvidenceTest, APartyCallsAUnitImpossibleOnceForAll) {
  EXPECT_EQ(Fail(kFirst, 1, ann_).Parties(), 0);
  EXPECT_EQ(Fail(kFirst, 2, ann_again_).Parties(), 0);
  EXPECT_EQ(Fail(kSecond, 1, ann_).Parties(), 0) << "another unit";
  EXPECT_FALSE(evidence_.IsExcluded(7, "ann", kNow));
  EXPECT_FALSE(evidence_.FirstDispute(7).has_value());
  EXPECT_EQ(Fail(kFirst, 1, ann_).Parties(), 1) << "the third time";
  const Evidence::Record& record = Fail(kFirst, 2, ann_again_, true);
  EXPECT_EQ(record.Parties(), 1);
  EXPECT_EQ(evidence_.WitnessesOf(record), 0);
  EXPECT_EQ(record.failures, 4);
  EXPECT_EQ(record.last_error, "error of ann:2");
  EXPECT_EQ(Fail(kFirst, 3, ben_, true).Parties(), 2);
  EXPECT_EQ(evidence_.FirstDispute(7), kFirst);
  EXPECT_FALSE(evidence_.FirstDispute(8).has_value());
  Fail({7, {0, 0}}, 1, ann_, true);
  EXPECT_EQ(evidence_.FirstDispute(7), kFirst) << "in the order of the words, not of the units";
  evidence_.Refute(kFirst);
  EXPECT_EQ(evidence_.FirstDispute(7), (UnitIndex{7, {0, 0}}));
}

TEST_F(EvidenceTest, WhoCallsAUnitImpossibleIsKeptFromItsJobForAWhile) {
  Fail(kFirst, 1, ann_, true);
  EXPECT_TRUE(evidence_.IsExcluded(7, "ann", kNow + kExclusion - absl::Seconds(1)));
  EXPECT_FALSE(evidence_.IsExcluded(7, "ann", kNow + kExclusion));
  EXPECT_FALSE(evidence_.IsExcluded(8, "ann", kNow));
  EXPECT_FALSE(evidence_.IsExcluded(7, "ben", kNow));
  evidence_.Refute(kFirst);
  EXPECT_TRUE(evidence_.IsExcluded(7, "ann", kNow)) << "it was wrong about the job";
  evidence_.EndJob(7);
  EXPECT_FALSE(evidence_.IsExcluded(7, "ann", kNow));
}

TEST_F(EvidenceTest, ThePartyOfALaterDeliveryWasAWitness) {
  const Evidence::Record& record = Fail(kFirst, 1, ann_, true);
  EXPECT_EQ(evidence_.WitnessesOf(record), 0);
  evidence_.AddWitness("ben");
  EXPECT_EQ(evidence_.WitnessesOf(record), 0);
  evidence_.AddWitness("ann");
  EXPECT_EQ(evidence_.WitnessesOf(record), 1);
  evidence_.AddProcess("ann", 2);
  EXPECT_EQ(evidence_.WitnessesOf(Fail(kSecond, 2, ann_again_, true)), 1) << "its next process is one, too";
}

TEST_F(EvidenceTest, ANewProcessIsAskedAgainUnlessTheLastOneDied) {
  Fail(kFirst, 1, ann_, true);
  Fail(kOfOther, 3, ben_, true);
  evidence_.AddLoss(kSecond, "ben", "lost", kNow);
  evidence_.AddProcess("ann", 1);
  evidence_.AddProcess("ann", 0);
  EXPECT_TRUE(evidence_.IsExcluded(7, "ann", kNow)) << "its connection broke, or nobody knows";
  EXPECT_EQ(evidence_.Find(kFirst)->Parties(), 1);
  evidence_.AddProcess("ann", 2);
  EXPECT_FALSE(evidence_.IsExcluded(7, "ann", kNow));
  EXPECT_EQ(evidence_.Find(kFirst)->Parties(), 0);
  evidence_.AddProcess("ben", 4);
  EXPECT_FALSE(evidence_.IsExcluded(8, "ben", kNow));
  EXPECT_EQ(evidence_.Find(kSecond)->Parties(), 1);
  EXPECT_TRUE(evidence_.IsExcluded(7, "ben", kNow));
  evidence_.RetractLoss(kSecond, "ben");
  EXPECT_EQ(evidence_.Find(kSecond)->Parties(), 0) << "it did not die after all";
  EXPECT_FALSE(evidence_.IsExcluded(7, "ben", kNow));
}

TEST_F(EvidenceTest, ADropIsNoFailureButTheUnitGoesToAnother) {
  evidence_.AddDrop(kFirst, WorkerId(1), ann_);
  EXPECT_TRUE(evidence_.WasLastToFail(kFirst, "ann:1"));
  EXPECT_EQ(Fail(kFirst, 3, ben_).failures, 1);
  EXPECT_TRUE(evidence_.WasLastToFail(kFirst, "ben:1"));
  EXPECT_FALSE(evidence_.WasLastToFail(kFirst, "ann:1"));
  EXPECT_FALSE(evidence_.WasLastToFail(kSecond, "ben:1"));
  EXPECT_THAT(evidence_.FailedWorkersOf(7), ElementsAre(WorkerId(1), WorkerId(3)));
  EXPECT_THAT(evidence_.Refute(kFirst), ElementsAre(WorkerId(1), WorkerId(3)));
  EXPECT_THAT(evidence_.Refute(kFirst), IsEmpty());
  EXPECT_FALSE(evidence_.WasLastToFail(kFirst, "ben:1")) << "it was rendered";
}

TEST_F(EvidenceTest, UnitsAreDueInTheOrderOfTheirTimesUntilTheyAreForgotten) {
  for (const UnitIndex& unit : {kFirst, kSecond, kOfOther}) Fail(unit, 1, ann_, true);
  EXPECT_EQ(evidence_.NextDue(), absl::InfiniteFuture());
  evidence_.SetDue(kFirst, kNow + absl::Seconds(9));
  evidence_.SetDue(kFirst, kNow + absl::Seconds(3));
  evidence_.SetDue(kSecond, kNow + absl::Seconds(1));
  evidence_.SetDue(kOfOther, kNow + absl::Seconds(2));
  EXPECT_EQ(evidence_.NextDue(), kNow + absl::Seconds(1));
  evidence_.EndJob(8);
  EXPECT_THAT(evidence_.TakeDue(kNow + absl::Seconds(3)), ElementsAre(kSecond, kFirst));
  EXPECT_THAT(evidence_.TakeDue(kNow + absl::Seconds(20)), IsEmpty());
  evidence_.SetDue(kSecond, kNow + absl::Seconds(30));
  evidence_.Refute(kSecond);
  EXPECT_EQ(evidence_.NextDue(), absl::InfiniteFuture());
}

}  // namespace
}  // namespace lumifold::scheduler
