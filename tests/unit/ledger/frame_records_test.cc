// What every JobStore does with frames that are finished, and with the rows of their units.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

#include "server/ledger/job_store.h"
#include "tests/unit/ledger/job_store_fixture.h"

namespace lumifold::ledger {
namespace {

using absl::StatusCode;
using job::JobId;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

TEST_P(JobStoreTest, FramesAreRecordedOnceAndTheirUnitsGo) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(CommitOne(Commit("j-a", {Unit("j-a", 1, 0, 0), Unit("j-a", 2, 0, 0)})).ok());
  v1::FrameReport report;
  report.mutable_times()->set_render_seconds(5.0);
  report.mutable_times()->set_filter_seconds(2.0);
  EXPECT_EQ(Get("j-a").estimated_error, std::nullopt);
  for (const int32_t frame : {3, 1, 3}) {
    report.set_estimated_error(frame);
    ASSERT_TRUE(store_->RecordFrame(Owned("j-a"), frame, report).ok());
  }
  EXPECT_EQ(Get("j-a").estimated_error, 3.0);
  EXPECT_THAT(*store_->FinishedFrames(JobId("j-a")), ElementsAre(1, 3));
  EXPECT_THAT(*store_->DeliverersOf(JobId("j-a")), ElementsAre("host:17")) << "of its units, too";
  EXPECT_THAT(Units("j-a", 1), IsEmpty());
  EXPECT_THAT(Units("j-a"), SizeIs(1));
  const JobRecord job = Get("j-a");
  EXPECT_EQ(job.done.frames, 2);
  EXPECT_EQ(job.done.units, 2);
  EXPECT_EQ(job.times.filter_seconds(), 4.0);
  EXPECT_EQ(job.times.render_seconds(), 5.0);
  const absl::Status late = CommitOne(Commit("j-a", {Unit("j-a", 1, 0, 0)}));
  EXPECT_EQ(late.code(), StatusCode::kAlreadyExists);
  EXPECT_THAT(std::string(late.message()), HasSubstr("j-a frame 1 tile 0 pass 0"));
}

TEST_P(JobStoreTest, AKeptFrameIsRecordedWithItsUnitsOrNotAtAll) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  JobCommit kept = Commit("j-a", {Unit("j-a", 1, 0, 0), Unit("j-a", 1, 1, 0)});
  kept.numeric_class = "avx2";
  kept.warnings = {"a warning"};
  kept.units[0].bad_samples = 2;
  kept.units[1].cost = {kStart, 2.5};
  v1::FrameReport report;
  report.mutable_times()->set_filter_seconds(2.0);
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(store_->RecordKeptFrame(kept, 1, report).ok()) << "repeated";
  const JobRecord job = Get("j-a");
  EXPECT_EQ(job.done.frames, 1);
  EXPECT_EQ(job.done.units, 2);
  EXPECT_EQ(job.done.bad_samples, 3);
  EXPECT_EQ(job.numeric_class, "avx2");
  EXPECT_EQ(job.times.filter_seconds(), 2.0);
  EXPECT_THAT(job.warnings, ElementsAre("a warning"));
  EXPECT_THAT(*store_->FinishedFrames(JobId("j-a")), ElementsAre(1));
  EXPECT_THAT(*store_->DeliverersOf(JobId("j-a")), ElementsAre("host:17"));
  EXPECT_THAT(Units("j-a"), IsEmpty());
  EXPECT_EQ(store_->PurgeUnits(100).value_or(-1), 0) << "it has no rows";
  ASSERT_TRUE(CommitOne(Commit("j-a", {Unit("j-a", 2, 0, 0)})).ok());
  const JobCommit other = Commit("j-a", {Unit("j-a", 2, 1, 0)});
  EXPECT_EQ(store_->RecordKeptFrame(other, 2, report).code(), StatusCode::kAlreadyExists);
  EXPECT_EQ(Get("j-a").done.frames, 1);
  EXPECT_EQ(Get("j-a").done.units, 3);
}

TEST_P(JobStoreTest, RowsOfUnitsGoInSmallBatches) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  std::vector<UnitRecord> units;
  for (int tile = 0; tile < 10; ++tile) {
    units.push_back(Unit("j-a", 0, tile, 0));
    units.push_back(Unit("j-a", 1, tile, 0));
    units.push_back(Unit("j-a", 2, tile, 0));
  }
  ASSERT_TRUE(CommitOne(Commit("j-a", units)).ok());
  EXPECT_EQ(*store_->PurgeUnits(100), 0);
  EXPECT_THAT(Units("j-a"), SizeIs(30));
  ASSERT_TRUE(store_->RecordFrame(Owned("j-a"), 0, {}).ok());
  EXPECT_EQ(*store_->PurgeUnits(4), 6);
  ASSERT_TRUE(store_->RecordFrame(Owned("j-a"), 1, {}).ok());
  EXPECT_EQ(*store_->PurgeUnits(7), 9);
  Reopen();
  EXPECT_EQ(*store_->PurgeUnits(9), 0);
  EXPECT_EQ(*store_->PurgeUnits(9), 0);
  EXPECT_THAT(Units("j-a"), SizeIs(10));
  ASSERT_TRUE(store_->EndJob(Owned("j-a"), {v1::JOB_STATE_CANCELLED, ""}).ok());
  EXPECT_THAT(Units("j-a"), IsEmpty());
  EXPECT_EQ(*store_->PurgeUnits(1), 9);
  EXPECT_EQ(*store_->PurgeUnits(100), 0);
  EXPECT_EQ(Get("j-a").done.units, 30);
}

TEST_P(JobStoreTest, FramesOfARunningJobAreReopened) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(CommitOne(Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 1, 0, 0)})).ok());
  ASSERT_TRUE(store_->RecordFrame(Owned("j-a"), 0, {}).ok());
  const JobRecord before = Get("j-a");
  ASSERT_TRUE(store_
                  ->ReopenFrames(JobId("j-a"), before.owner,
                                 {.spec = before.spec, .scheduling = {}, .frames = {0, 1, 5}})
                  .ok());
  EXPECT_THAT(Units("j-a"), IsEmpty());
  EXPECT_EQ(Get("j-a").done.units, 0);
  EXPECT_EQ(Get("j-a").done.frames, 0);
  EXPECT_EQ(Get("j-a").numeric_class, "");  // nothing is left that binds it
  JobCommit commit = Commit("j-a", {Unit("j-a", 0, 0, 0)});
  commit.numeric_class = "sse2";
  ASSERT_TRUE(CommitOne(commit).ok());
  EXPECT_EQ(Get("j-a").numeric_class, "sse2");
  EXPECT_EQ(store_->ReopenFrames(JobId("j-x"), before.owner, {}).code(), StatusCode::kNotFound);
}

}  // namespace
}  // namespace lumifold::ledger
