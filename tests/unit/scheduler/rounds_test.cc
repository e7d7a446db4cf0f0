// Frames with adaptive sampling: which units are leased when, and when they are committed.
#include <memory>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::FrameRounds;
using ::testing::IsEmpty;

constexpr int kTiles = 4;
constexpr int kFrame = 10;

class RoundsTest : public SchedulerFixture {
 protected:
  RoundsTest() {
    spec_ = Spec();
    spec_.set_samples_per_pixel(400);
    spec_.mutable_adaptive();
    scheduler_.jobs().Add(kJob, spec_);
    scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1000});
  }

  /// After one estimate in which only this tile of 2 x 2 erred.
  std::shared_ptr<const FrameRounds> Decided(int tile = 3) const {
    v1::RoundEstimates estimates;
    v1::RoundEstimate* estimate = estimates.add_estimates();
    const int columns = BlocksIn(spec_.width());
    const int rows = BlocksIn(spec_.height());
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        estimate->add_errors(2 * (row / (rows / 2)) + column / (columns / 2) == tile ? 100 : 0);
        estimate->add_costs(8);
      }
    }
    return std::make_shared<const FrameRounds>(*FrameRounds::Replay(spec_, estimates));
  }

  v1::JobSpec spec_;
};

TEST_F(RoundsTest, TheFirstRoundsAreLeasedAndThenWhatIsDecided) {
  const std::vector<GrantedLease> first = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(first.size(), 4u * kTiles) << "geometry and three rounds";
  EXPECT_EQ(first.back().samples.At(0, 0), (SampleRange{48, 96}));
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_total, 4 * kTiles);
  for (const GrantedLease& lease : first) EXPECT_FALSE(Commit(kAnn, lease)) << "the frame is not final";
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 3);
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  EXPECT_FALSE(scheduler_.frames().SetRounds(kJob, kFrame, Decided()));
  const std::vector<GrantedLease> second = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(second.size(), 1u);
  EXPECT_EQ(second[0].unit.key, (job::UnitKey{kFrame, 3, 3, v1::UNIT_KIND_PASS}));
  EXPECT_EQ(second[0].samples.At(0, 0).first, 96u);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_total, 4 * kTiles + 1);
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 3);
  Commit(kAnn, second[0]);
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 4);
  EXPECT_FALSE(scheduler_.frames().IsCommitted(kJob, kFrame));
}

TEST_F(RoundsTest, ARoundHasAnyTileThatErred) {
  scheduler_.jobs().End(kJob);
  for (int tile = 0; tile < kTiles; ++tile) {
    const job::JobId job(absl::StrCat("j-tile-", tile));
    scheduler_.jobs().Add(job, spec_);
    for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) Commit(kAnn, lease);
    scheduler_.frames().SetRounds(job, kFrame, Decided(tile));
    const std::vector<GrantedLease> second = scheduler_.GrantLeases(kStart);
    ASSERT_EQ(second.size(), 1u) << tile;
    EXPECT_EQ(second[0].unit.key, (job::UnitKey{kFrame, tile, 3, v1::UNIT_KIND_PASS}));
    scheduler_.jobs().End(job);
  }
}

TEST_F(RoundsTest, ARoundIsNotCommittedBeforeItsLastUnit) {
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  for (size_t i = 0; i < leases.size(); ++i) {
    if (i != 2 * kTiles) Commit(kAnn, leases[i]);  // all but one of round 1
  }
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 1);
  Commit(kAnn, leases[2 * kTiles]);
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 3);
  EXPECT_TRUE(scheduler_.units().Revoke(leases[kTiles].unit));
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 0);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 1u);
}

TEST_F(RoundsTest, ACommittedFrameIsNotCommittedAfterAUnitOfAnEarlierRoundIsRevoked) {
  spec_.set_samples_per_pixel(30);  // one round, which is final
  scheduler_.jobs().Add(kOther, spec_);
  scheduler_.jobs().End(kJob);
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  for (const GrantedLease& lease : leases) Commit(kAnn, lease);
  ASSERT_TRUE(scheduler_.frames().IsCommitted(kOther, kFrame));
  for (const size_t unit : {size_t{0}, leases.size() - 1}) {  // of the geometry, and of the round
    const int64_t samples = scheduler_.jobs().Progress(kOther).samples_done;
    EXPECT_TRUE(scheduler_.units().Revoke(leases[unit].unit));
    EXPECT_EQ(scheduler_.frames().CommittedRounds(kOther, kFrame), 0);
    EXPECT_FALSE(scheduler_.frames().IsCommitted(kOther, kFrame));
    EXPECT_THAT(scheduler_.frames().Committed(kOther), IsEmpty());
    EXPECT_FALSE(scheduler_.frames().Finish(kOther, kFrame));
    const std::vector<GrantedLease> again = scheduler_.GrantLeases(kStart);
    ASSERT_EQ(again.size(), 1u);
    EXPECT_EQ(again[0].unit, leases[unit].unit);
    EXPECT_TRUE(Commit(kAnn, again[0]));
    EXPECT_EQ(scheduler_.jobs().Progress(kOther).samples_done, samples);
  }
}

TEST_F(RoundsTest, ARevokedUnitReopensItsRoundWhenLaterRoundsAreDecided) {
  const std::vector<GrantedLease> first = scheduler_.GrantLeases(kStart);
  for (const GrantedLease& lease : first) Commit(kAnn, lease);
  scheduler_.frames().SetRounds(kJob, kFrame, Decided());
  const std::vector<GrantedLease> later = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(later.size(), 1u);
  Commit(kAnn, later[0]);
  ASSERT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 4);
  EXPECT_TRUE(scheduler_.units().Revoke(first[2 * kTiles].unit));
  EXPECT_FALSE(scheduler_.units().Revoke(first[2 * kTiles].unit)) << "it is not committed any more";
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 1);
  EXPECT_TRUE(scheduler_.units().Revoke(later[0].unit));
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 1);
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) Commit(kAnn, lease);
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 4);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_done, scheduler_.jobs().Progress(kJob).units_total);
}

TEST_F(RoundsTest, AFrameIsRestoredWithItsRounds) {
  scheduler_.frames().SetRounds(kJob, kFrame, Decided());
  const job::UnitKey later = {kFrame, 3, 3, v1::UNIT_KIND_PASS};
  EXPECT_TRUE(scheduler_.units().Restore(kJob, {later}, kStart));
  EXPECT_FALSE(scheduler_.units().Restore(kJob, {{kFrame, 0, 3, v1::UNIT_KIND_PASS}}, kStart))
      << "the frame does not have it";
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) {
    EXPECT_NE(lease.unit.key, later);
    Commit(kAnn, lease);
  }
  EXPECT_EQ(scheduler_.frames().CommittedRounds(kJob, kFrame), 4);
}

TEST_F(RoundsTest, ASmallBudgetIsOneRound) {
  spec_.set_samples_per_pixel(30);
  scheduler_.jobs().Add(kOther, spec_);
  scheduler_.jobs().End(kJob);
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(leases.size(), 2u * kTiles);
  for (size_t i = 0; i + 1 < leases.size(); ++i) EXPECT_FALSE(Commit(kAnn, leases[i]));
  EXPECT_TRUE(Commit(kAnn, leases.back()));
}

}  // namespace
}  // namespace lumifold::scheduler
