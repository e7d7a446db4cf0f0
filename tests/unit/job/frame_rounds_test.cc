#include "server/job/frame_rounds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace lumifold::job {
namespace {

/// 3 x 2 tiles of 8 x 8 blocks, except at the right border, where a tile has 4 x 8.
v1::JobSpec Spec(int samples = 400) {
  v1::JobSpec spec;
  spec.set_width(40);
  spec.set_height(32);
  spec.set_tile_size(16);
  spec.set_pass_samples(64);
  spec.set_samples_per_pixel(samples);
  spec.mutable_adaptive();
  return spec;
}

constexpr int kBlocks = 20 * 16;

UnitKey Pass(int32_t tile, int32_t pass) { return {0, tile, pass, v1::UNIT_KIND_PASS}; }

/// No error but in the first block, which has `first`.
v1::RoundEstimates Estimates(double first) {
  v1::RoundEstimates estimates;
  v1::RoundEstimate* estimate = estimates.add_estimates();
  for (int i = 0; i < kBlocks; ++i) {
    estimate->add_errors(i == 0 ? first : 0);
    estimate->add_costs(4);
  }
  return estimates;
}

TEST(FrameRounds, BeginsUniformly) {
  const FrameRounds rounds(Spec());
  EXPECT_EQ(rounds.count(), 3);
  EXPECT_EQ(rounds.estimated(), 1);
  EXPECT_FALSE(rounds.is_final());
  const std::vector<SampleRange> uniform = {{0, 16}, {16, 48}, {48, 96}};
  for (int32_t pass = 0; pass < 3; ++pass) {
    const SampleRange range = uniform[static_cast<size_t>(pass)];
    const TileSamples samples = rounds.SamplesOf(Pass(2, pass));
    EXPECT_EQ(samples.blocks().size(), 32u);
    EXPECT_EQ(samples.At(7, 15), range);
    EXPECT_EQ(rounds.CameraSamplesOf(Pass(2, pass)), 8 * 16 * int64_t{range.count()});
  }
  const std::vector<double> ones(kBlocks, 1);  // equal costs: mean samples of a pixel
  EXPECT_EQ(rounds.MeanCostOf(0, ones), 16);
  EXPECT_EQ(rounds.MeanCostOf(2, ones), 96);
  EXPECT_TRUE(rounds.Has({0, 2, 0, v1::UNIT_KIND_GEOMETRY}));
  EXPECT_FALSE(rounds.Has(Pass(2, 3)));
}

TEST(FrameRounds, SpendsASmallBudgetUniformly) {
  const FrameRounds rounds(Spec(30));
  EXPECT_EQ(rounds.count(), 1);
  EXPECT_TRUE(rounds.is_final());
  EXPECT_EQ(rounds.SamplesOf(Pass(0, 0)).At(0, 0), (SampleRange{0, 30}));
}

TEST(FrameRounds, GoesOnWhereThePictureErrs) {
  const absl::StatusOr<FrameRounds> rounds = FrameRounds::Replay(Spec(), Estimates(100));
  ASSERT_TRUE(rounds.ok());
  EXPECT_EQ(rounds->count(), 4);
  EXPECT_EQ(rounds->estimated(), 2);
  ASSERT_TRUE(rounds->Has(Pass(0, 3)));
  const TileSamples samples = rounds->SamplesOf(Pass(0, 3));
  EXPECT_EQ(samples.At(0, 0).first, 96u) << "each round begins where the one before it ended";
  EXPECT_GT(samples.At(0, 0).count(), samples.At(8, 8).count());
  EXPECT_FALSE(rounds->Has(Pass(5, 3))) << "a tile without errors gets no samples in this round";
}

TEST(FrameRounds, AScheduleTakesThePlaceOfTheBudgetsThatATimeRecorded) {
  v1::JobSpec timed = Spec();
  timed.mutable_adaptive()->set_time_seconds(60);
  v1::RoundEstimates estimates = Estimates(100);
  estimates.mutable_estimates(0)->set_budget(48.25);
  const absl::StatusOr<FrameRounds> recorded = FrameRounds::Replay(timed, estimates);
  ASSERT_TRUE(recorded.ok());
  EXPECT_EQ(recorded->schedule(), std::vector<double>({48.25}));
  v1::JobSpec scheduled = Spec();
  scheduled.mutable_adaptive()->add_schedule(48.25);
  const absl::StatusOr<FrameRounds> replayed = FrameRounds::Replay(scheduled, Estimates(100));
  ASSERT_TRUE(replayed.ok());
  EXPECT_EQ(recorded->count(), 3);
  EXPECT_EQ(replayed->count(), 3);
  EXPECT_EQ(FrameRounds::Replay(Spec(), Estimates(100))->count(), 4) << "there is more to spend without them";
}

TEST(FrameRounds, RefusesEstimatesThatDoNotFit) {
  EXPECT_EQ(FrameRounds::Replay(Spec(30), Estimates(1)).status().code(), absl::StatusCode::kDataLoss)
      << "its rounds are final";
  v1::RoundEstimates estimates = Estimates(1);
  estimates.mutable_estimates(0)->add_errors(1);
  EXPECT_FALSE(FrameRounds::Replay(Spec(), estimates).ok());
  EXPECT_FALSE(FrameRounds::Replay(Spec(), Estimates(std::numeric_limits<double>::infinity())).ok());
  EXPECT_FALSE(FrameRounds::Replay(Spec(), Estimates(NAN)).ok());
  estimates = Estimates(1);
  estimates.mutable_estimates(0)->set_costs(3, 0);
  EXPECT_FALSE(FrameRounds::Replay(Spec(), estimates).ok());
  for (const double budget : {-1.0, 0.5, 401.0, static_cast<double>(NAN)}) {
    estimates = Estimates(1);
    estimates.mutable_estimates(0)->set_budget(budget);
    EXPECT_FALSE(FrameRounds::Replay(Spec(), estimates).ok()) << budget;
  }
}

}  // namespace
}  // namespace lumifold::job
