#include "server/finish/finish_frame.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "filter/image/layers.h"
#include "filter/methods.h"
#include "server/commit/committed_units.h"
#include "server/film/matte.h"
#include "server/film/result.h"
#include "server/film/unit_film.h"
#include "server/picture/make_picture.h"
#include "tests/support/film_of_units.h"
#include "tests/support/same_image.h"
#include "tests/unit/server/committed_frame_fixture.h"

namespace lumifold::server {
namespace {

using job::JobId;

const JobId kFilteredJob("j-1");
const ledger::OwnedJob kOwnedFilteredJob = {kFilteredJob, {}};
/// Divides the frames of these tests into several blocks.
constexpr filter::BlockParams kSmallBlocks = {.core = 64, .margin = 32, .fade = 16, .whole = 4096};

/// Filters a film in memory.
std::array<Plane, 3> Filtered(const EdgedImage& film, const std::string& method,
                              const filter::BlockParams& blocks) {
  FilmInMemory source(film.pixels, &film.edges, &film.fragments);
  std::vector<LayeredImage> pieces;
  const auto keep = [&](const LayeredImage& rows) {
    pieces.push_back(rows.Crop(rows.bounds()));
    return absl::OkStatus();
  };
  EXPECT_TRUE(filter::FilterFilmInRows(&source, method, {}, nullptr, keep, blocks).ok());
  LayeredImage rows = JoinRows(pieces);
  std::array<Plane, 3> picture;
  for (size_t c = 0; c < picture.size(); ++c) picture[c] = std::move(rows.channels()[c].plane);
  return picture;
}

EdgedImage ExpectedResult(const v1::JobSpec& spec, const filter::BlockParams& blocks) {
  EdgedImage film = *WholeFilm(spec, 0, RandomUnitsOf(spec, 1));
  std::array<Plane, 3> picture = Filtered(film, spec.filter().method(), blocks);
  if (spec.ground() == v1::GROUND_SHADOW) {
    const EdgedImage shadows = {film::ShadowFilmOf(film.pixels), {}, {}};
    film.pixels.Add(layers::kShadow, std::move(Filtered(shadows, spec.filter().method(), blocks)[0]));
  }
  return film::BuildResult(std::move(film), std::move(picture),
                           {.spec = spec, .frame = 0, .numeric_class = ""});
}

class FinishFrameTest : public CommittedFrameFixture {
 protected:
  v1::StageTimes Finish(const JobId& job, TaskPool* pool, const filter::BlockParams& blocks) {
    const absl::StatusOr<v1::FrameReport> report =
        FinishFrame(folder_, *store_, {job, {}}, 0, pool, [] { return absl::Now(); }, blocks);
    EXPECT_TRUE(report.ok()) << report.status();
    return report->times();
  }
};

TEST_F(FinishFrameTest, AFrameOfOneBlockIsTheWholeFilmFiltered) {
  v1::JobSpec spec = Spec(40, 30);
  spec.set_save_film(true);
  Commit(kFilteredJob, spec);
  Finish(kFilteredJob, nullptr, {});
  const absl::StatusOr<EdgedImage> result = ReadEdgedExr(folder_.ResultPath(kFilteredJob, 0));
  ASSERT_TRUE(result.ok()) << result.status();
  const EdgedImage expected = ExpectedResult(spec, {});
  ExpectSameImage(result->pixels, expected.pixels);
  ExpectSameImage(result->edges, expected.edges);
  ExpectSameImage(result->fragments, expected.fragments);
  EXPECT_EQ(result->pixels.metadata(), expected.pixels.metadata());
}

TEST_F(FinishFrameTest, AFrameOfSeveralBlocksIsTheWholeFilmFilteredInBlocks) {
  for (const bool save_film : {false, true}) {
    v1::JobSpec spec = Spec(120, 80);
    spec.set_tile_size(save_film ? 24 : 16);
    spec.mutable_filter()->set_method(save_film ? "default" : "bilateral");
    spec.set_save_film(save_film);
    const JobId job(save_film ? "j-film" : "j-picture");
    Commit(job, spec);
    Finish(job, MakeTaskPool(2).get(), kSmallBlocks);
    const absl::StatusOr<EdgedImage> result = ReadEdgedExr(folder_.ResultPath(job, 0));
    ASSERT_TRUE(result.ok()) << result.status();
    const EdgedImage expected = ExpectedResult(spec, kSmallBlocks);
    ExpectSameImage(result->pixels, expected.pixels);
    ExpectSameImage(result->edges, expected.edges);
    ExpectSameImage(result->fragments, expected.fragments);
    EXPECT_EQ(result->pixels.metadata(), expected.pixels.metadata());
  }
}

TEST_F(FinishFrameTest, ShadowsAreFilteredAsThePictureIs) {
  for (const filter::BlockParams& blocks : {filter::BlockParams(), kSmallBlocks}) {
    v1::JobSpec spec = Spec(120, 80);
    spec.set_background(v1::BACKGROUND_TRANSPARENT);
    spec.set_ground(v1::GROUND_SHADOW);
    const JobId job(absl::StrCat("j-", blocks.core));
    Commit(job, spec);
    Finish(job, nullptr, blocks);
    const absl::StatusOr<EdgedImage> result = ReadEdgedExr(folder_.ResultPath(job, 0));
    ASSERT_TRUE(result.ok()) << result.status();
    ExpectSameImage(result->pixels, ExpectedResult(spec, blocks).pixels);
  }
}

TEST_F(FinishFrameTest, BlocksThatWereMadeBeforeAreUsedAndTheFileIsTheSame) {
  v1::JobSpec spec = Spec(120, 80);
  spec.set_save_film(true);
  for (const JobId& job : {kFilteredJob, JobId("j-2")}) Commit(job, spec);
  Finish(kFilteredJob, nullptr, kSmallBlocks);
  const JobId other("j-2");
  const ledger::JobRecord record = *store_->GetJob(other);
  const FrameBlocks blocks(spec, kSmallBlocks);
  ASSERT_EQ(blocks.count(), 4);
  ASSERT_TRUE(MakeFolder(folder_.ResultsPath(other), folder_.files()).ok());
  for (const int block : {0, 2, 3}) {
    CommittedUnits units = *CommittedUnits::Open(folder_, *store_, record, 0);
    const film::LevelSet levels = film::UnitFilm::Open(spec, 0, &units, nullptr)->levels();
    units.KeepTiles(job::FrameUnits(spec).tiles().TilesIn(blocks.Input(block)));
    EXPECT_EQ(units.count() == units.places(), false);
    const absl::StatusOr<std::string> picture =
        MakeBlock({.spec = spec, .numeric_class = "", .units = units}, block, levels, nullptr, kSmallBlocks);
    ASSERT_TRUE(picture.ok()) << picture.status();
    EXPECT_EQ(picture->size(), blocks.PictureBytes(block));
    std::ofstream(folder_.BlockPath(other, 0, block), std::ios::binary) << *picture;
  }
  // Of block 2 a damaged file is left, of block 3 nothing.
  std::ofstream(folder_.BlockPath(other, 0, 2), std::ios::binary) << "short";
  EXPECT_EQ(
      FinishFrame(folder_, *store_, {other, {}}, 0, nullptr, [] { return absl::Now(); }, kSmallBlocks, {2})
          .status()
          .code(),
      absl::StatusCode::kDataLoss);
  std::filesystem::remove(folder_.BlockPath(other, 0, 3));
  ASSERT_TRUE(
      FinishFrame(folder_, *store_, {other, {}}, 0, nullptr, [] { return absl::Now(); }, kSmallBlocks, {0, 3})
          .ok());
  EXPECT_EQ(Result(kFilteredJob), Result(other));
}

TEST_F(FinishFrameTest, TheFileKnowsNothingOfTheLogsThatUnitsAreIn) {
  v1::JobSpec spec = Spec(20, 12);
  spec.mutable_filter()->set_method("none");
  Commit(kFilteredJob, spec);
  Finish(kFilteredJob, nullptr, {});
  const JobId other("j-2");
  logs_ = 3;
  Commit(other, spec);
  Finish(other, nullptr, {});
  EXPECT_EQ(Result(kFilteredJob), Result(other));
}

TEST_F(FinishFrameTest, TheFileKnowsNothingOfThreadsOrTheOrderOfUnits) {
  v1::JobSpec spec = Spec(120, 80);
  spec.mutable_filter()->set_method("none");
  spec.set_save_film(true);
  Commit(kFilteredJob, spec);
  Finish(kFilteredJob, nullptr, kSmallBlocks);
  const JobId other("j-2");
  Commit(other, spec, /*is_forward=*/true);
  Finish(other, MakeTaskPool(4).get(), kSmallBlocks);
  EXPECT_EQ(Result(kFilteredJob), Result(other));
}

TEST_F(FinishFrameTest, StagesMakeUpTheWholeTime) {
  v1::JobSpec spec = Spec(120, 80);
  spec.mutable_filter()->set_method("none");
  Commit(kFilteredJob, spec);
  absl::Time time = absl::FromUnixSeconds(1000);
  const absl::StatusOr<v1::FrameReport> report = FinishFrame(
      folder_, *store_, kOwnedFilteredJob, 0, nullptr, [&] { return time += absl::Seconds(1); },
      kSmallBlocks);
  ASSERT_TRUE(report.ok()) << report.status();
  const int blocks = 2 * 2;
  const int bands = 10;  // tiles of 8 rows
  EXPECT_EQ(report->times().assemble_seconds(), 1 + blocks + bands);
  EXPECT_EQ(report->times().filter_seconds(), blocks + bands);
  EXPECT_EQ(report->times().write_seconds(), 1 + bands + 1);
}

TEST_F(FinishFrameTest, AUnitThatIsNotCommittedIsNamedAndNothingIsWritten) {
  v1::JobSpec spec = Spec(20, 12);
  Commit(kFilteredJob, spec);
  spec.set_samples_per_pixel(14);  // one pass more than is committed
  const JobId other("j-2");
  ASSERT_TRUE(
      store_->CreateJob({.id = other, .request_id = "r", .spec = spec, .submitted = absl::Now()}).ok());
  const absl::Status status =
      FinishFrame(folder_, *store_, {other, {}}, 0, nullptr, [] { return absl::Now(); }).status();
  EXPECT_EQ(status, absl::DataLossError("ledger: tile 0 has units that are not committed"));
  EXPECT_EQ(Result(other), "");
}

TEST_F(FinishFrameTest, AJobThatAnotherCoordinatorHasTakenKeepsItsResult) {
  Commit(kFilteredJob, Spec(20, 12));
  ASSERT_TRUE(store_->ClaimUnfinishedJobs({"another", ledger::Epoch(7)}).ok());
  ASSERT_TRUE(MakeFolder(folder_.ResultsPath(kFilteredJob)).ok());
  std::ofstream(folder_.ResultPath(kFilteredJob, 0)) << "of the other one";
  const absl::Status status =
      FinishFrame(folder_, *store_, kOwnedFilteredJob, 0, nullptr, [] { return absl::Now(); }).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kAborted) << status;
  EXPECT_EQ(Result(kFilteredJob), "of the other one");
  EXPECT_TRUE(FinishFrame(folder_, *store_, {kFilteredJob, ledger::Epoch(7)}, 0, nullptr, [] {
                return absl::Now();
              }).ok());
}

}  // namespace
}  // namespace lumifold::server
