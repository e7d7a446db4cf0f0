#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "filter/image/file_io.h"
#include "tests/charts/constants.h"
#include "tests/charts/region_report.h"
#include "tests/charts/report.h"
#include "tests/charts/row.h"
#include "tests/charts/row_store.h"
#include "tests/charts/series.h"
#include "tests/charts/tuning_set.h"

namespace lumifold::charts {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

Row MakeRow(const std::string& method, int samples, double error, double filter_seconds) {
  Row row;
  row.scene = "room";
  row.samples = samples;
  row.method = method;
  row.is_default = row.is_best = true;
  row.errors.mse255.whole = error;
  row.render_seconds = samples;
  row.filter_seconds = filter_seconds;
  return row;
}

/// Noise that falls by four with four times the samples; the default has a tenth of it, a baseline a fifth.
std::vector<Row> Rows() {
  std::vector<Row> rows;
  for (const int samples : {4, 16}) {
    rows.push_back(MakeRow("none", samples, 400.0 / samples, 0));
    rows.push_back(MakeRow("default", samples, 40.0 / samples, 1));
    for (const char* baseline : {"manifolds-color", "bilateral", "cross-bilateral", "a-trous",
                                 "a-trous-variance", "guided", "nlm", "nfor"})
      rows.push_back(MakeRow(baseline, samples, 80.0 / samples, 0.5));
  }
  return rows;
}

Row& RowOf(std::vector<Row>* rows, const std::string& method, int samples) {
  return *std::find_if(rows->begin(), rows->end(),
                       [&](const Row& row) { return row.method == method && row.samples == samples; });
}

class RowStoreTest : public ::testing::Test {
 protected:
  ~RowStoreTest() override { std::filesystem::remove(path_); }

  const std::string path_ =
      ::testing::TempDir() + "/" + ::testing::UnitTest::GetInstance()->current_test_info()->name() + ".txt";
};

TEST(Row, SurvivesItsText) {
  Row row = MakeRow("guided", 16, 1.25, 0.5);
  row.parameters = "radius=3,epsilon=0.1";
  row.errors.mse255.of_region[1] = 7;
  row.errors.flip = 0.125;
  row.errors.ssim.reset();
  const Row read = *DecodeRow(EncodeRow(row));
  EXPECT_EQ(read.parameters, row.parameters);
  EXPECT_EQ(read.errors.mse255.whole, 1.25);
  EXPECT_EQ(read.errors.mse255.of_region[1], 7);
  EXPECT_EQ(read.errors.flip, 0.125);
  EXPECT_FALSE(read.errors.ssim.has_value());  // not 0
  EXPECT_TRUE(absl::IsDataLoss(DecodeRow("{\"scene\": 3}").status()));
}

TEST_F(RowStoreTest, KeepsRowsFromOneRunToTheNext) {
  {
    RowStore store = *RowStore::Open(path_);
    EXPECT_FALSE(store.Find("a film").has_value());
    ASSERT_TRUE(store.Add("a film", MakeRow("nlm", 4, 3, 1)).ok());
    ASSERT_TRUE(store.Add("a film", MakeRow("nlm", 4, 2, 1)).ok());
  }
  const RowStore store = *RowStore::Open(path_);
  ASSERT_TRUE(store.Find("a film").has_value());
  EXPECT_EQ(store.Find("a film")->errors.mse255.whole, 2);  // the later one
  EXPECT_FALSE(store.Find("another film").has_value());
}

TEST_F(RowStoreTest, LeavesOutALineThatWasCutShortAndNamesABadOne) {
  const std::string line = "key\t" + EncodeRow(MakeRow("nlm", 4, 3, 1)) + "\n";
  ASSERT_TRUE(WriteFileAtomically(path_, line + "other\t{\"scen").ok());
  EXPECT_TRUE(RowStore::Open(path_)->Find("key").has_value());
  ASSERT_TRUE(WriteFileAtomically(path_, line + "other\t{}\n").ok());
  EXPECT_THAT(std::string(RowStore::Open(path_).status().message()), HasSubstr(path_ + ":2: "));
}

TEST(Series, InterpolateOnLogarithmicAxes) {
  const std::vector<std::pair<double, double>> points = {{1, 100}, {100, 1}};
  EXPECT_NEAR(*Interpolate(points, 10), 10, 1e-9);
  EXPECT_NEAR(*Interpolate(points, 1), 100, 1e-9);
  EXPECT_FALSE(Interpolate(points, 101).has_value());
  EXPECT_FALSE(Interpolate({{1, 2}}, 1).has_value());
}

TEST(Series, TakeTheBestThatRan) {
  std::vector<Row> rows = Rows();
  RowOf(&rows, "nlm", 4).not_run = "cost";
  const std::vector<Row> best = BestRows(rows, "room", "nlm");
  ASSERT_EQ(best.size(), 1u);
  EXPECT_EQ(best[0].samples, 16);
  EXPECT_THAT(ErrorByTime(best), ElementsAre(std::pair(16.5, 5.0)));
}

TEST(RatioTable, SaysWhyAMethodDidNotRun) {
  std::vector<Row> rows = Rows();
  RowOf(&rows, "nlm", 16).not_run = "cost: 52 s";
  const std::string table = RatioTable(rows);
  EXPECT_THAT(table, HasSubstr("0.500 | not run, cost: 52 s | 0.500"));
  EXPECT_THAT(table, HasSubstr("| room | judged | 4 | 100.000 | 10.000 | 0.500"));
}

TEST(TruthTable, NamesNoiseThatIsTakenOff) {
  const std::string table = TruthTable({{"room", 4096, 0.25}, {"hall", 512, 0}});
  EXPECT_THAT(table, HasSubstr("| room | 4096 | 0.250 |"));
  EXPECT_THAT(table, HasSubstr("| hall | 512 | not known |"));
}

TEST(CheckOrder, HoldsWhereOursIsBest) { EXPECT_TRUE(CheckOrder(Rows()).ok()) << CheckOrder(Rows()); }

TEST(CheckOrder, NamesAFilmWhereTheNoisyPictureIsBetter) {
  std::vector<Row> rows = Rows();
  RowOf(&rows, "default", 4).errors.mse255.whole = 101;
  EXPECT_EQ(CheckOrder(rows).message(), "room, 4 spp: default has MSE255 101.000, the noisy picture 100.000");
}

TEST(CheckOrder, NamesABaselineThatIsBetterInTheSum) {
  std::vector<Row> rows = Rows();
  RowOf(&rows, "guided", 4).errors.mse255.whole = 0.1;
  RowOf(&rows, "guided", 4).is_default = false;  // found by a grid search: not part of the front
  EXPECT_EQ(CheckOrder(rows).message(),
            "sum over all films: default has MSE255 12.500, the best of guided 5.100");
}

TEST(CheckOrder, NamesAMethodThatIsBetterInLessTime) {
  std::vector<Row> rows = Rows();
  rows.push_back(MakeRow("cache", 4, 2, 0));
  EXPECT_EQ(CheckOrder(rows).message(),
            "room: cache at 4 spp has less error in less time than default at 16");
  rows.back().is_default = false;  // found by a grid search on this film
  EXPECT_TRUE(CheckOrder(rows).ok());
}

TEST(RatioTable, SetsOursOverEachBest) {
  const std::string table = RatioTable(Rows());
  EXPECT_THAT(table, HasSubstr("| scene | set | spp | noisy | default | manifolds-color |"));
  EXPECT_THAT(table, HasSubstr("| room | judged | 16 | 25.000 | 2.500 | 0.500 |"));
  EXPECT_THAT(table, HasSubstr("| geometric mean |  |  |  |  | 0.500 |"));
  EXPECT_THAT(table, Not(HasSubstr("geometric mean, ")));  // all films are judged
}

TEST(RatioTable, HasMeansOfEachSet) {
  std::vector<Row> rows = {MakeRow("default", 4, 1, 0), MakeRow("nlm", 4, 2, 0), MakeRow("default", 4, 1, 0),
                           MakeRow("nlm", 4, 8, 0)};
  for (size_t i = 2; i < 4; ++i) {
    rows[i].scene = "bedroom";
    rows[i].width = 256;
    rows[i].height = 192;
  }
  const std::string table = RatioTable(rows);
  EXPECT_THAT(table, HasSubstr("| bedroom | tuning | 4 |"));
  EXPECT_THAT(table, HasSubstr("| geometric mean, tuning |  |  |  |  | 0.125 |"));
  EXPECT_THAT(table, HasSubstr("| geometric mean, judged |  |  |  |  | 0.500 |"));
  EXPECT_THAT(table, HasSubstr("| geometric mean |  |  |  |  | 0.250 |"));
}

TEST(TuningSet, IsOfScenesAtSizes) {
  EXPECT_TRUE(IsTuning("cornell-box", 256, 192));
  EXPECT_TRUE(IsTuning("bedroom", 1024, 768));
  EXPECT_FALSE(IsTuning("cornell-box", 500, 281));
  EXPECT_FALSE(IsTuning("atrium", 256, 192));
  EXPECT_EQ(SceneHeading("staircase", 256, 192), "staircase (judged)");
}

TEST(WriteCsv, LeavesScoresWithoutAValueBlank) {
  const std::string path = ::testing::TempDir() + "/scores.csv";
  std::vector<Row> rows = {MakeRow("none", 4, 2, 0), MakeRow("default", 4, 1, 0)};
  rows[1].errors.ssim = 0.5;
  rows[1].errors.flip = 0.25;
  ASSERT_TRUE(WriteCsv(path, rows).ok());
  const std::string text = *ReadFile(path, 1 << 20);
  EXPECT_THAT(text, HasSubstr("scene,width,height,set,spp,"));
  EXPECT_THAT(text, HasSubstr("room,0,0,judged,4,none,"));
  EXPECT_THAT(text, HasSubstr(",0,0,0,0,0,0,,,4.0000,"));  // regions, relMSE, no SSIM, no FLIP
  EXPECT_THAT(text, HasSubstr(",0,0,0,0,0,0,0.5,0.25,4.0000,"));
  std::filesystem::remove(path);
}

/// A film whose only regions are edges and flat surfaces, half of the picture each.
Row RegionRow(const std::string& method, double whole, double edges, double flat) {
  Row row = MakeRow(method, 16, whole, 0);
  row.errors.mse255.of_region = {edges, 0, 0, 0, flat};
  row.errors.mse255.share = {0.5, 0, 0, 0, 0.5};
  return row;
}

TEST(LossesText, NamesEachRegionWithMoreErrorThanAnother) {
  const std::string text = LossesText({RegionRow("none", 9, 9, 9), RegionRow("default", 2, 3, 1),
                                       RegionRow("nfor", 2.5, 2, 3), RegionRow("guided", 4, 4, -0.1)});
  EXPECT_THAT(text, HasSubstr("in 2 of 3 whole pictures and regions"));
  EXPECT_THAT(text, HasSubstr("* room (judged), 16 spp, edges: nfor 1.500\n"));
  EXPECT_THAT(text, HasSubstr("* room (judged), 16 spp, flat: guided (within the reference's noise)\n"));
}

TEST(LossesText, ComparesWithTheBestPointAlone) {
  std::vector<Row> rows = {RegionRow("default", 2, 3, 1), RegionRow("nfor", 1, 1, 1)};
  rows[1].is_best = false;
  EXPECT_THAT(LossesText(rows), HasSubstr("no more error than any other method"));
  rows[1].is_best = true;
  EXPECT_THAT(LossesText(rows), HasSubstr("* room (judged), 16 spp, whole picture: nfor 2.000\n"));
  rows[1].not_run = "cost: 60 s";
  EXPECT_THAT(LossesText(rows), HasSubstr("no more error than any other method"));
}

TEST(LossesText, SaysThatTheDefaultIsMissing) {
  EXPECT_EQ(LossesText({RegionRow("none", 9, 9, 9)}), "The default was not measured.\n");
}

TEST(RegionTable, HasTheDefaultFirstAndDashesForWhatIsNotThere) {
  std::vector<Row> rows = {RegionRow("nfor", 2.5, 2, 3), RegionRow("none", 9, 8, 10),
                           RegionRow("default", 2, 3, 1)};
  rows[2].errors.ssim = 0.75;
  EXPECT_THAT(RegionTable(rows),
              HasSubstr("| room | judged | 16 | default | 2.000 | 3.000 | - | - | - | 1.000 | 0.750 | - |\n"
                        "| room | judged | 16 | none | 9.000 | 8.000 | - | - | - | 10.000 | - | - |\n"
                        "| room | judged | 16 | nfor |"));
}

ConstantPoint PointOf(const std::string& constant, double value, double error, double halved,
                      double doubled) {
  ConstantPoint point;
  point.constant = constant;
  point.unit = "px";
  point.value = value;
  point.error = error;
  point.halved_error = halved;
  point.doubled_error = doubled;
  return point;
}

TEST(ConstantsTable, HasGeometricMeansOverFilms) {
  const std::string table = ConstantsTable({PointOf("reach", 6, 1, 2, 1), PointOf("knee", 1, 1, 1, 1),
                                            PointOf("reach", 8.5, 2, 16, 1), PointOf("reach", 6, 0, 1, 1)});
  EXPECT_THAT(table, HasSubstr("| reach | px | 6 to 8.5 | 4.000 | 0.707 | 8.000 | 1.000 |\n"
                               "| knee | px | 1 | 1.000 | 1.000 | 1.000 | 1.000 |\n"));
}

}  // namespace
}  // namespace lumifold::charts
