#include "server/commit/revise_film.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <utility>

#include "server/film/unit_log.h"
#include "server/job/job_spec.h"
#include "tests/support/encoded_unit.h"
#include "tests/support/random_unit.h"
#include "tests/support/temp_folder.h"

namespace lumifold::server {
namespace {

using job::ReopenPlan;
using job::ReopenRequest;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const job::JobId kRevisedJob("j-1");

/// A done job of two tiles, two passes of 4 and 2 samples, and frames 0 and 1, of which frame 0 has a log.
class ReviseFilmTest : public ::testing::Test {
 protected:
  ReviseFilmTest() {
    v1::JobSpec spec;
    spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
    spec.set_width(16);
    spec.set_height(8);
    spec.set_tile_size(8);
    spec.set_samples_per_pixel(6);
    spec.set_pass_samples(4);
    spec.set_frame_count(2);
    job_ = {*job::NormaliseJobSpec(spec), v1::JOB_STATE_DONE, {0, 1}, {0, 1}};
    EXPECT_TRUE(MakeFolder(data_.FilmPath(kRevisedJob)).ok());
    absl::StatusOr<film::UnitLog> log = film::UnitLog::Open(log_, 0);
    const job::FrameUnits units(job_.spec);
    for (int64_t number = 0; number < units.count(); ++number) {
      const job::UnitKey key = units.KeyOf(0, number);
      const film::StoredUnit unit{{kRevisedJob, key},
                                  job::Attempt(number),
                                  {},
                                  RandomUnit(key, units.tiles().RectOf(key.tile), units.SamplesOf(key), 1)};
      EXPECT_TRUE(log->Append(Encoded(unit)).ok());
    }
    EXPECT_TRUE(log->Sync().ok());
  }

  absl::StatusOr<std::vector<int32_t>> Revise(const ReopenRequest& request) {
    return ReviseFilm(data_, kRevisedJob, *ReopenPlan::Make(job_, request));
  }
  /// Tile and pass of the units that the log has; pass -1 is the geometry.
  std::set<std::pair<int32_t, int32_t>> Units() const {
    std::set<std::pair<int32_t, int32_t>> units;
    const absl::StatusOr<film::UnitLogReader> log = film::UnitLogReader::Open(log_);
    EXPECT_TRUE(log->Scan(0,
                          [&](const film::StoredUnit& unit, const film::RecordPlace&) {
                            const job::UnitKey& key = unit.unit.key;
                            units.emplace(key.tile, key.kind == v1::UNIT_KIND_GEOMETRY ? -1 : key.pass);
                          })
                    .ok());
    return units;
  }

  TempFolder folder_;
  const DataFolder data_{folder_.path()};
  const std::string log_ = data_.PathOf(data_.UnitLogName(kRevisedJob, 0));
  job::ReopenedJob job_;
};

using Pair = std::pair<int32_t, int32_t>;

TEST_F(ReviseFilmTest, MoreSamplesTakeOutTheShortPass) {
  EXPECT_THAT(*Revise({.samples_per_pixel = 8}), ElementsAre(1));  // frame 1 has no log
  EXPECT_THAT(Units(), ElementsAre(Pair(0, -1), Pair(0, 0), Pair(1, -1), Pair(1, 0)));
  EXPECT_TRUE(Revise({.samples_per_pixel = 8}).ok());
  EXPECT_EQ(Units().size(), 4u);
}

TEST_F(ReviseFilmTest, ARegionTakesOutItsTiles) {
  EXPECT_THAT(*Revise({.frames = {0}, .region = Rect{0, 0, 1, 1}}), IsEmpty());
  EXPECT_THAT(Units(), ElementsAre(Pair(1, -1), Pair(1, 0), Pair(1, 1)));
}

TEST_F(ReviseFilmTest, AWholeFrameLosesItsLog) {
  EXPECT_TRUE(Revise({.frames = {0}}).ok());
  EXPECT_FALSE(std::filesystem::exists(log_));
}

TEST_F(ReviseFilmTest, FilteringAgainKeepsTheLogAndNeedsIt) {
  EXPECT_TRUE(Revise({.frames = {0}, .filter_only = true}).ok());
  EXPECT_EQ(Units().size(), 6u);
  const absl::Status refused = Revise({.filter_only = true}).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("frame 1"));
  EXPECT_FALSE(Revise({.region = Rect{0, 0, 1, 1}}).ok());
  EXPECT_EQ(Units().size(), 6u);  // nothing is changed where a frame is refused
}

}  // namespace
}  // namespace lumifold::server
