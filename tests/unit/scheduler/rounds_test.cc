// Frames with adaptive sampling: which units are leased when, and when they are committed.
#include <memory>

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
    scheduler_.AddJob(kJob, spec_);
    scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1000});
  }

  /// After one estimate in which only tile 3 erred.
  std::shared_ptr<const FrameRounds> Decided() const {
    v1::RoundEstimates estimates;
    v1::RoundEstimate* estimate = estimates.add_estimates();
    const int columns = BlocksIn(spec_.width());
    const int rows = BlocksIn(spec_.height());
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        estimate->add_errors(row >= rows / 2 && column >= columns / 2 ? 100 : 0);
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
  EXPECT_EQ(scheduler_.Progress(kJob).units_total, 4 * kTiles);
  for (const GrantedLease& lease : first) EXPECT_FALSE(Commit(kAnn, lease)) << "the frame is not final";
  EXPECT_EQ(scheduler_.CommittedRounds(kJob, kFrame), 3);
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  EXPECT_FALSE(scheduler_.SetRounds(kJob, kFrame, Decided()));
  const std::vector<GrantedLease> second = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(second.size(), 1u);
  EXPECT_EQ(second[0].unit.key, (job::UnitKey{kFrame, 3, 3, v1::UNIT_KIND_PASS}));
  EXPECT_EQ(second[0].samples.At(0, 0).first, 96u);
  EXPECT_EQ(scheduler_.Progress(kJob).units_total, 4 * kTiles + 1);
  EXPECT_EQ(scheduler_.CommittedRounds(kJob, kFrame), 3);
  Commit(kAnn, second[0]);
  EXPECT_EQ(scheduler_.CommittedRounds(kJob, kFrame), 4);
  EXPECT_FALSE(scheduler_.IsFrameCommitted(kJob, kFrame));
}

TEST_F(RoundsTest, ARoundIsNotCommittedBeforeItsLastUnit) {
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  for (size_t i = 0; i < leases.size(); ++i) {
    if (i != 2 * kTiles) Commit(kAnn, leases[i]);  // all but one of round 1
  }
  EXPECT_EQ(scheduler_.CommittedRounds(kJob, kFrame), 1);
  Commit(kAnn, leases[2 * kTiles]);
  EXPECT_EQ(scheduler_.CommittedRounds(kJob, kFrame), 3);
  EXPECT_TRUE(scheduler_.RevokeUnit(leases[kTiles].unit));
  EXPECT_EQ(scheduler_.CommittedRounds(kJob, kFrame), 0);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 1u);
}

TEST_F(RoundsTest, AFrameIsRestoredWithItsRounds) {
  scheduler_.SetRounds(kJob, kFrame, Decided());
  const job::UnitKey later = {kFrame, 3, 3, v1::UNIT_KIND_PASS};
  EXPECT_TRUE(scheduler_.RestoreCommittedUnit(kJob, {later}, kStart));
  EXPECT_FALSE(scheduler_.RestoreCommittedUnit(kJob, {{kFrame, 0, 3, v1::UNIT_KIND_PASS}}, kStart))
      << "the frame does not have it";
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) {
    EXPECT_NE(lease.unit.key, later);
    Commit(kAnn, lease);
  }
  EXPECT_EQ(scheduler_.CommittedRounds(kJob, kFrame), 4);
}

TEST_F(RoundsTest, ASmallBudgetIsOneRound) {
  spec_.set_samples_per_pixel(30);
  scheduler_.AddJob(kOther, spec_);
  scheduler_.EndJob(kJob);
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(leases.size(), 2u * kTiles);
  for (size_t i = 0; i + 1 < leases.size(); ++i) EXPECT_FALSE(Commit(kAnn, leases[i]));
  EXPECT_TRUE(Commit(kAnn, leases.back()));
}

}  // namespace
}  // namespace lumifold::scheduler
