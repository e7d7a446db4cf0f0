#include "server/cluster/lease_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace lumifold::cluster {
namespace {

using ledger::Epoch;
using ledger::Member;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr absl::Duration kWatchedLease = absl::Seconds(3);
constexpr absl::Duration kRead = absl::Milliseconds(500);

class LeaseWatchTest : public ::testing::Test {
 protected:
  /// Reads once more; the members with these epochs have renewed meanwhile. Returns the epochs of those that
  /// have expired.
  std::vector<int64_t> Read(const std::vector<int64_t>& renewed, absl::Duration pause = kRead) {
    now_ += pause;
    for (Member& member : members_) {
      for (const int64_t epoch : renewed) member.renewals += member.owner.epoch == Epoch(epoch) ? 1 : 0;
    }
    std::vector<int64_t> epochs;
    for (const Member& member : watch_.Expired(members_, now_)) epochs.push_back(member.owner.epoch.value());
    return epochs;
  }

  LeaseWatch watch_{kWatchedLease};
  absl::Time now_ = absl::UnixEpoch();
  static Member Of(int64_t epoch) {
    Member member;
    member.owner.epoch = Epoch(epoch);
    return member;
  }

  std::vector<Member> members_ = {Of(1), Of(2)};
};

TEST_F(LeaseWatchTest, AMemberThatStandsStillForALeaseHasExpired) {
  EXPECT_THAT(Read({1, 2}), IsEmpty());
  for (int i = 0; i < 5; ++i) EXPECT_THAT(Read({1}), IsEmpty());
  EXPECT_THAT(Read({1}), ElementsAre(2));
  EXPECT_THAT(Read({1, 2}), IsEmpty());  // it was only slow
}

TEST_F(LeaseWatchTest, AMemberThatRenewsJustInTimeStays) {
  EXPECT_THAT(Read({1, 2}), IsEmpty());
  for (int round = 0; round < 4; ++round) {
    for (int i = 0; i < 5; ++i) EXPECT_THAT(Read({1}), IsEmpty());
    EXPECT_THAT(Read({1, 2}), IsEmpty());
  }
}

TEST_F(LeaseWatchTest, AMemberIsWatchedFromWhenItIsFirstSeen) {
  EXPECT_THAT(Read({1, 2}), IsEmpty());
  members_.push_back(Of(3));
  for (int i = 0; i < 6; ++i) EXPECT_THAT(Read({1, 2}), IsEmpty());
  EXPECT_THAT(Read({1, 2}), ElementsAre(3));
}

// A database that was down for a minute, or a reader that was stopped: nobody could renew, or nobody looked.
TEST_F(LeaseWatchTest, APauseOfTheReaderIsNobodysFault) {
  EXPECT_THAT(Read({1, 2}), IsEmpty());
  EXPECT_THAT(Read({}, absl::Minutes(1)), IsEmpty());
  for (int i = 0; i < 5; ++i) EXPECT_THAT(Read({}), IsEmpty());
  EXPECT_THAT(Read({}), ElementsAre(1, 2));
}

}  // namespace
}  // namespace lumifold::cluster
