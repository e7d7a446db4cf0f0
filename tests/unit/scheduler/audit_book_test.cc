#include "server/scheduler/audit_book.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/unit_names.h"

namespace lumifold::scheduler {
namespace {

using Outcome = AuditBook::Outcome;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr absl::Duration kPatience = absl::Minutes(5);
constexpr UnitIndex kOfNextFrame{7, {1, 0}};

class AuditBookTest : public ::testing::Test {
 protected:
  /// A worker leases the job's next audit, which is that of the unit, and votes.
  AuditBook::Verdict Vote(const UnitIndex& unit, const std::string& worker, const std::string& digest,
                          absl::Time now = kNow) {
    EXPECT_EQ(book_.Take(unit.job, worker), unit.place) << worker;
    return book_.Vote(unit, worker, digest, now);
  }

  AuditBook book_{kPatience};
};

TEST_F(AuditBookTest, TwoEqualDigestsSettleAnAudit) {
  EXPECT_TRUE(book_.Begin(kFirst, "ann", "x", kNow));
  EXPECT_TRUE(book_.HasReady(7));
  const AuditBook::Verdict verdict = Vote(kFirst, "ben", "x");
  EXPECT_EQ(verdict.outcome, Outcome::kSettled);
  EXPECT_THAT(verdict.wrong, IsEmpty());
  EXPECT_TRUE(book_.HasOpen(7, 0)) << "until it is ended";
  EXPECT_TRUE(book_.End(kFirst));
  EXPECT_FALSE(book_.HasOpen(7, 0));
  EXPECT_FALSE(book_.End(kFirst));
  EXPECT_EQ(book_.CountsOf(7).settled, 1);
  EXPECT_EQ(book_.CountsOf(7).waived, 0);
}

TEST_F(AuditBookTest, TheMinorityIsWrongWhoeverVotedFirst) {
  book_.Begin(kFirst, "ann", "wrong", kNow);
  EXPECT_EQ(Vote(kFirst, "ben", "right").outcome, Outcome::kOpen);
  EXPECT_THAT(Vote(kFirst, "cid", "right").wrong, ElementsAre("ann"));
  book_.End(kFirst);
  book_.Begin(kSecond, "ann", "right", kNow);
  Vote(kSecond, "ben", "wrong");
  EXPECT_THAT(Vote(kSecond, "cid", "right").wrong, ElementsAre("ben"));
}

TEST_F(AuditBookTest, FiveThatDifferLeaveTheAuditUndecided) {
  book_.Begin(kFirst, "w1", "1", kNow);
  for (int i = 2; i <= 4; ++i)
    EXPECT_EQ(Vote(kFirst, absl::StrCat("w", i), absl::StrCat(i)).outcome, Outcome::kOpen) << i;
  const AuditBook::Verdict verdict = Vote(kFirst, "w5", "5");
  EXPECT_EQ(verdict.outcome, Outcome::kUndecided);
  EXPECT_THAT(verdict.wrong, IsEmpty());
  EXPECT_FALSE(book_.HasReady(7));
  EXPECT_EQ(book_.CountsOf(7).waived, 1);
}

TEST_F(AuditBookTest, AWorkerRendersAUnitOnce) {
  book_.Begin(kFirst, "ann", "x", kNow);
  EXPECT_FALSE(book_.Take(7, "ann").has_value()) << "it delivered the unit";
  EXPECT_FALSE(book_.Take(8, "ben").has_value()) << "of another job";
  EXPECT_EQ(book_.Take(7, "ben"), kFirst.place);
  EXPECT_TRUE(book_.IsLeased(kFirst));
  EXPECT_FALSE(book_.HasReady(7));
  EXPECT_FALSE(book_.Take(7, "cid").has_value()) << "one lease at a time";
  book_.Decline(kFirst, "ben");
  EXPECT_TRUE(book_.Return(kFirst));
  EXPECT_FALSE(book_.IsLeased(kFirst));
  EXPECT_FALSE(book_.Take(7, "ben").has_value()) << "it could not";
  EXPECT_THAT(book_.AskedOf(kFirst), ElementsAre("ann", "ben"));
  EXPECT_EQ(book_.Take(7, "cid"), kFirst.place);
}

TEST_F(AuditBookTest, AnAuditThatIsReturnedIsReadyWithItsVotes) {
  book_.Begin(kFirst, "ann", "1", kNow);
  Vote(kFirst, "ben", "2");
  book_.Begin(kSecond, "ann", "x", kNow);
  EXPECT_EQ(book_.Take(7, "cid"), kSecond.place) << "fewer votes";
  EXPECT_EQ(book_.Take(7, "cid"), kFirst.place);
  book_.End(kFirst);
  EXPECT_FALSE(book_.Return(kFirst)) << "it has ended";
  EXPECT_FALSE(book_.HasReady(7));
}

TEST_F(AuditBookTest, WithoutADigestAnAuditIsWaived) {
  EXPECT_FALSE(book_.Begin(kFirst, "ann", "", kNow));
  EXPECT_FALSE(book_.Begin(kSecond, "", "x", kNow));
  EXPECT_EQ(book_.CountsOf(7).waived, 2);
  EXPECT_EQ(book_.CountsOf(7).open, 0);
  EXPECT_EQ(book_.NextDue(), absl::InfiniteFuture());
}

TEST_F(AuditBookTest, AnAuditIsDueAfterThePatienceSinceItsLastVote) {
  book_.Begin(kFirst, "ann", "1", kNow);
  EXPECT_EQ(book_.NextDue(), kNow + kPatience);
  const absl::Time voted = kNow + absl::Minutes(1);
  Vote(kFirst, "ben", "2", voted);
  EXPECT_THAT(book_.TakeDue(kNow + kPatience), IsEmpty()) << "there was a vote since";
  EXPECT_THAT(book_.TakeDue(voted + kPatience), ElementsAre(kFirst));
  book_.Extend(kFirst, voted + kPatience);
  EXPECT_THAT(book_.TakeDue(voted + 2 * kPatience - absl::Nanoseconds(1)), IsEmpty());
  EXPECT_THAT(book_.TakeDue(voted + 2 * kPatience), ElementsAre(kFirst));
  book_.Waive(kFirst);
  EXPECT_EQ(book_.CountsOf(7).waived, 1);
  EXPECT_FALSE(book_.HasOpen(7, 0));
}

TEST_F(AuditBookTest, AuditsAreOfAFrameAndEndWithTheJob) {
  book_.Begin(kOfNextFrame, "ann", "x", kNow);
  EXPECT_FALSE(book_.HasOpen(7, 0));
  EXPECT_TRUE(book_.HasOpen(7, 1));
  EXPECT_FALSE(book_.HasOpen(8, 1));
  book_.Begin(kFirst, "ann", "x", kNow);
  EXPECT_EQ(book_.FirstOf(7), kFirst.place);
  EXPECT_EQ(book_.CountsOf(7).open, 2);
  book_.EndJob(7);
  EXPECT_FALSE(book_.HasReady(7));
  EXPECT_EQ(book_.CountsOf(7).open, 0);
  EXPECT_THAT(book_.TakeDue(absl::InfiniteFuture()), IsEmpty());
}

}  // namespace
}  // namespace lumifold::scheduler
