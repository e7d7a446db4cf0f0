#include "server/finish/estimate_round.h"

#include <gtest/gtest.h>

#include <vector>

#include "filter/image/tile_samples.h"
#include "proto/rpc/checked_file.h"
#include "tests/unit/server/committed_frame_fixture.h"

namespace lumifold::server {
namespace {

using job::JobId;
using job::UnitKey;

const JobId kJob("j-1");

/// Frames of 3 x 2 tiles with three rounds before the first estimate.
class EstimateRoundTest : public CommittedFrameFixture {
 protected:
  static v1::JobSpec AdaptiveSpec() {
    v1::JobSpec spec = Spec(24, 16);
    spec.set_samples_per_pixel(400);
    spec.set_pass_samples(64);
    spec.mutable_adaptive()->set_target_error(1e-6);
    return spec;
  }

  /// Commits the units of the rounds up to `last`.
  void CommitUpTo(int last, const JobId& job, const v1::JobSpec& spec = AdaptiveSpec()) {
    Commit(job, spec, /*is_forward=*/true,
           [last](const UnitKey& key) { return key.kind != v1::UNIT_KIND_PASS || key.pass <= last; });
  }

  absl::Status Estimate(const JobId& job, int round) {
    const RoundToEstimate what = {.job = job, .epoch = {}, .frame = 0, .round = round};
    return EstimateRound(folder_, *store_, what, nullptr, [] { return absl::Now(); }).status();
  }

  std::string Record(const JobId& job) const {
    return rpc::ReadCheckedFile(folder_.RoundsPath(job, 0), {"LFRB", "the record", 1 << 20}).value_or("");
  }
  v1::RoundEstimate FirstOf(const JobId& job) const {
    v1::RoundEstimates estimates;
    EXPECT_TRUE(estimates.ParseFromString(Record(job)));
    return estimates.estimates_size() == 1 ? estimates.estimates(0) : v1::RoundEstimate();
  }
};

TEST_F(EstimateRoundTest, TheCostOfABlockIsThatOfItsTileOverTheRoundsSoFar) {
  const v1::JobSpec spec = AdaptiveSpec();
  const job::FrameUnits units(spec);
  const job::FrameRounds rounds(spec);
  rays_of_ = [&](const UnitKey& key) {
    const std::vector<int64_t> costs = {key.tile + 1, key.tile + 4, 99};
    const bool is_counted = key.kind == v1::UNIT_KIND_PASS && rounds.Has(key);
    return is_counted ? rounds.CameraSamplesOf(key) * costs.at(static_cast<size_t>(key.pass)) : int64_t{0};
  };
  CommitUpTo(2, kJob);
  ASSERT_TRUE(Estimate(kJob, 1).ok());
  const v1::RoundEstimate estimate = FirstOf(kJob);
  ASSERT_EQ(estimate.costs_size(), 12 * 8);
  ASSERT_EQ(estimate.errors_size(), 12 * 8);
  const double first = rounds.SamplesOf({0, 0, 0, v1::UNIT_KIND_PASS}).At(0, 0).count();
  const double second = rounds.SamplesOf({0, 0, 1, v1::UNIT_KIND_PASS}).At(0, 0).count();
  for (int32_t tile = 0; tile < 6; ++tile) {
    const double mean = tile + (first * 1 + second * 4) / (first + second);
    const Rect rect = units.tiles().RectOf(tile);
    for (int y = rect.y0 / kSampleBlock; y < rect.y1 / kSampleBlock; ++y) {
      for (int x = rect.x0 / kSampleBlock; x < rect.x1 / kSampleBlock; ++x)
        EXPECT_DOUBLE_EQ(estimate.costs(y * 12 + x), mean) << x << " " << y;
    }
  }
}

TEST_F(EstimateRoundTest, IsMadeOfTheUnitsUpToItsRoundAlone) {
  CommitUpTo(1, kJob);
  const JobId other_now("j-now");
  const JobId other_later("j-later");
  seed_of_ = [](const UnitKey& key) { return key.pass == 1 ? 2u : 1u; };
  CommitUpTo(1, other_now);
  seed_of_ = [](const UnitKey& key) { return key.pass == 2 ? 2u : 1u; };
  CommitUpTo(2, other_later);
  for (const JobId& job : {kJob, other_now, other_later}) ASSERT_TRUE(Estimate(job, 1).ok());
  EXPECT_EQ(Record(kJob), Record(other_later));
  EXPECT_NE(Record(kJob), Record(other_now));
}

TEST_F(EstimateRoundTest, ARoundIsEstimatedOnceAndInItsTurn) {
  CommitUpTo(2, kJob);
  EXPECT_EQ(Estimate(kJob, 2).code(), absl::StatusCode::kFailedPrecondition) << "round 1 comes first";
  EXPECT_EQ(Record(kJob), "");
  ASSERT_TRUE(Estimate(kJob, 1).ok());
  const std::string record = Record(kJob);
  EXPECT_TRUE(Estimate(kJob, 1).ok()) << "as after a crash before it was known";
  EXPECT_TRUE(Estimate(kJob, 0).ok());
  EXPECT_EQ(Record(kJob), record);
  ASSERT_TRUE(Estimate(kJob, 2).ok());
  EXPECT_NE(Record(kJob), record);
}

TEST_F(EstimateRoundTest, AUnitThatIsNotCommittedIsNamedAndNothingIsWritten) {
  CommitUpTo(0, kJob);
  EXPECT_EQ(Estimate(kJob, 1).code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(Record(kJob), "");
}

}  // namespace
}  // namespace lumifold::server
