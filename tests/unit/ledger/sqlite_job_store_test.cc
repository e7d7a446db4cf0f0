#include "server/ledger/sqlite_job_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <fstream>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/job/limits.h"
#include "tests/support/temp_folder.h"

namespace lumifold::ledger {
namespace {

using job::JobId;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const absl::Time kStart = absl::FromUnixMillis(1'700'000'000'123);

NewJob Job(const std::string& id, const std::string& request_id) {
  NewJob job{.id = JobId(id), .request_id = request_id, .spec = {}, .submitted = kStart};
  job.spec.set_width(640);
  job.spec.mutable_scene()->set_display_name("room.glb");
  return job;
}

UnitRecord Unit(const std::string& job, int32_t frame, int32_t tile, int32_t pass,
                v1::UnitKind kind = v1::UNIT_KIND_PASS) {
  return {.unit = {JobId(job), {frame, tile, pass, kind}},
          .file = "film/x",
          .offset = uint64_t{1} << 40,
          .length = 77,
          .samples = 100,
          .bad_samples = 1};
}

class SqliteJobStoreTest : public ::testing::Test {
 protected:
  SqliteJobStoreTest() { Reopen(); }

  void Reopen() {
    store_.reset();
    absl::StatusOr<std::unique_ptr<JobStore>> store = OpenSqliteJobStore(path_);
    ASSERT_TRUE(store.ok()) << store.status();
    store_ = *std::move(store);
  }

  std::vector<UnitRecord> Units(const char* job, std::optional<int32_t> frame = std::nullopt) {
    std::vector<UnitRecord> units;
    EXPECT_TRUE(
        store_->ForEachUnit(JobId(job), frame, [&](const UnitRecord& unit) { units.push_back(unit); }).ok());
    return units;
  }

  TempFolder folder_;
  const std::string path_ = folder_.PathOf("ledger.db");
  std::unique_ptr<JobStore> store_;
};

TEST_F(SqliteJobStoreTest, KeepsJobsAcrossReopening) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  Reopen();
  const absl::StatusOr<JobRecord> job = store_->GetJob(JobId("j-a"));
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->id, JobId("j-a"));
  EXPECT_EQ(job->spec.width(), 640);
  EXPECT_EQ(job->state, v1::JOB_STATE_QUEUED);
  EXPECT_EQ(job->submitted, kStart);
  EXPECT_EQ(job->started, absl::InfinitePast());
  EXPECT_EQ(store_->GetJob(JobId("j-b")).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(SqliteJobStoreTest, OneRequestMakesOneJob) {
  EXPECT_EQ(*store_->CreateJob(Job("j-a", "r-1")), JobId("j-a"));
  EXPECT_EQ(*store_->CreateJob(Job("j-b", "r-1")), JobId("j-a"));
  EXPECT_EQ(*store_->CreateJob(Job("j-c", "r-2")), JobId("j-c"));
  EXPECT_THAT(*store_->ListJobs(10), SizeIs(2));
}

TEST_F(SqliteJobStoreTest, AnIdThatIsTakenIsAnError) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  EXPECT_EQ(store_->CreateJob(Job("j-a", "r-2")).status().code(), absl::StatusCode::kAlreadyExists);
}

TEST_F(SqliteJobStoreTest, ListsNewestFirst) {
  for (const char* id : {"j-b", "j-a", "j-c"}) ASSERT_TRUE(store_->CreateJob(Job(id, id)).ok());
  const absl::StatusOr<std::vector<JobRecord>> jobs = store_->ListJobs(2);
  ASSERT_TRUE(jobs.ok());
  ASSERT_EQ(jobs->size(), 2u);
  EXPECT_EQ(jobs->at(0).id, JobId("j-c"));
  EXPECT_EQ(jobs->at(1).id, JobId("j-a"));
  EXPECT_EQ(store_->UnfinishedJobs()->at(0).id, JobId("j-b"));
}

TEST_F(SqliteJobStoreTest, AUnitEntersOnceAndItsBatchWithIt) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(store_->CommitUnits({Unit("j-a", 0, 0, 0), Unit("j-a", 0, 0, 1)}, {}).ok());
  const absl::Status again = store_->CommitUnits({Unit("j-a", 0, 1, 0), Unit("j-a", 0, 0, 1)}, {});
  EXPECT_EQ(again.code(), absl::StatusCode::kAlreadyExists);
  EXPECT_THAT(std::string(again.message()), HasSubstr("j-a frame 0 tile 0 pass 1"));
  Reopen();
  EXPECT_THAT(Units("j-a", 0), SizeIs(2));
  EXPECT_EQ(store_->GetJob(JobId("j-a"))->units_done, 2);
  EXPECT_EQ(store_->GetJob(JobId("j-a"))->samples_done, 200);
  EXPECT_EQ(store_->GetJob(JobId("j-a"))->bad_samples, 2);
}

TEST_F(SqliteJobStoreTest, UnitsOfAnUnknownJobAreRefused) {
  EXPECT_FALSE(store_->CommitUnits({Unit("j-none", 0, 0, 0)}, {}).ok());
}

TEST_F(SqliteJobStoreTest, UnitsComeInTheOrderOfTheFilm) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(store_
                  ->CommitUnits({Unit("j-a", 1, 0, 0), Unit("j-a", 0, 1, 1), Unit("j-a", 0, 1, 0),
                                 Unit("j-a", 0, 0, 0, v1::UNIT_KIND_GEOMETRY), Unit("j-a", 0, 0, 0)},
                                {})
                  .ok());
  std::vector<std::string> names;
  for (const UnitRecord& unit : Units("j-a")) names.push_back(Describe(unit.unit));
  EXPECT_THAT(names, ElementsAre("j-a frame 0 tile 0 pass 0", "j-a frame 0 tile 0 geometry",
                                 "j-a frame 0 tile 1 pass 0", "j-a frame 0 tile 1 pass 1",
                                 "j-a frame 1 tile 0 pass 0"));
  const UnitRecord unit = Units("j-a", 1).at(0);
  EXPECT_EQ(unit.file, "film/x");
  EXPECT_EQ(unit.offset, uint64_t{1} << 40);
  EXPECT_EQ(unit.length, 77u);
}

TEST_F(SqliteJobStoreTest, UpdatesBindTheClassOnceAndKeepEachWarningOnce) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(store_->CommitUnits({}, {{JobId("j-a"), "avx2", kStart, {"no light", "no camera"}}}).ok());
  ASSERT_TRUE(
      store_->CommitUnits({}, {{JobId("j-a"), "sse2", kStart + absl::Hours(1), {"big", "no light"}}}).ok());
  Reopen();
  const JobRecord job = *store_->GetJob(JobId("j-a"));
  EXPECT_EQ(job.numeric_class, "avx2");
  EXPECT_EQ(job.started, kStart);
  EXPECT_THAT(job.warnings, ElementsAre("no light", "no camera", "big"));
}

TEST_F(SqliteJobStoreTest, RevokedUnitsCanBeCommittedAgain) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  const std::vector<UnitRecord> units = {Unit("j-a", 0, 0, 0), Unit("j-a", 0, 1, 0), Unit("j-a", 0, 2, 0)};
  ASSERT_TRUE(store_->CommitUnits(units, {}).ok());
  const JobRecord before = *store_->GetJob(JobId("j-a"));
  const std::vector<UnitRecord> lost = {units[1], units[2], Unit("j-a", 0, 3, 0)};  // the last never was
  ASSERT_TRUE(store_->RevokeUnits(JobId("j-a"), lost).ok());
  Reopen();
  const JobRecord after = *store_->GetJob(JobId("j-a"));
  EXPECT_EQ(after.units_done, before.units_done - 2);
  EXPECT_EQ(after.samples_done, before.samples_done - units[1].samples - units[2].samples);
  EXPECT_EQ(after.bad_samples, before.bad_samples - 2);
  ASSERT_TRUE(store_->CommitUnits({units[1], units[2]}, {}).ok());
  EXPECT_EQ(store_->GetJob(JobId("j-a"))->samples_done, before.samples_done);
  EXPECT_EQ(store_->RevokeUnits(JobId("j-x"), lost).code(), absl::StatusCode::kNotFound);
}

TEST_F(SqliteJobStoreTest, WarningsAreLimitedAndTheRestIsCounted) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  JobUpdate update{JobId("j-a"), "avx2", kStart, {}};
  for (int i = 0; i < job::kMaxJobWarnings + 3; ++i) update.warnings.push_back(absl::StrCat("warning ", i));
  update.warnings.push_back(update.warnings.back());  // of a second unit
  update.warnings.emplace_back("warning 0");
  ASSERT_TRUE(store_->CommitUnits({}, {update}).ok());
  ASSERT_TRUE(store_->CommitUnits({}, {{JobId("j-a"), "avx2", kStart, {"one more", "warning 1"}}}).ok());
  Reopen();
  const JobRecord job = *store_->GetJob(JobId("j-a"));
  EXPECT_EQ(job.warnings.size(), size_t{job::kMaxJobWarnings});
  EXPECT_EQ(job.warnings.back(), absl::StrCat("warning ", job::kMaxJobWarnings - 1));
  EXPECT_EQ(job.warnings_left_out, 5);
}

TEST_F(SqliteJobStoreTest, ALedgerOfSchema1IsTakenOver) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  store_.reset();
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
  std::string sql = "ALTER TABLE jobs DROP COLUMN warnings_left_out; PRAGMA user_version=1;";
  for (int i = 0; i < 2 * job::kMaxJobWarnings; ++i)
    absl::StrAppend(&sql, "INSERT INTO warnings(job, line) VALUES(1, '", i, std::string(10'000, 'x'), "');");
  ASSERT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
  sqlite3_close(db);
  store_ = *OpenSqliteJobStore(path_);
  const JobRecord job = *store_->GetJob(JobId("j-a"));
  EXPECT_EQ(job.spec.SerializeAsString(), Job("j-a", "r-1").spec.SerializeAsString());
  EXPECT_EQ(job.warnings.size(), size_t{job::kMaxJobWarnings});
  EXPECT_LE(job.warnings.front().size(), 512u);
  EXPECT_EQ(job.warnings_left_out, 0);
}

TEST_F(SqliteJobStoreTest, FramesAreRecordedOnce) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  v1::StageTimes times;
  times.set_render_seconds(5.0);
  times.set_filter_seconds(2.0);
  for (const int32_t frame : {3, 1, 3}) ASSERT_TRUE(store_->RecordFrame(JobId("j-a"), frame, times).ok());
  EXPECT_THAT(*store_->FinishedFrames(JobId("j-a")), ElementsAre(1, 3));
  const JobRecord job = *store_->GetJob(JobId("j-a"));
  EXPECT_EQ(job.frames_done, 2);
  EXPECT_EQ(job.times.filter_seconds(), 4.0);
  EXPECT_EQ(job.times.render_seconds(), 5.0);
}

TEST_F(SqliteJobStoreTest, AnEndedJobStaysAsItIs) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(store_->EndJob(JobId("j-a"), v1::JOB_STATE_FAILED, "it's \"broken\"").ok());
  ASSERT_TRUE(store_->EndJob(JobId("j-a"), v1::JOB_STATE_DONE, "").ok());
  Reopen();
  EXPECT_EQ(store_->GetJob(JobId("j-a"))->state, v1::JOB_STATE_FAILED);
  EXPECT_EQ(store_->GetJob(JobId("j-a"))->error, "it's \"broken\"");
  EXPECT_THAT(*store_->UnfinishedJobs(), IsEmpty());
  EXPECT_EQ(store_->EndJob(JobId("j-x"), v1::JOB_STATE_DONE, "").code(), absl::StatusCode::kNotFound);
}

TEST_F(SqliteJobStoreTest, ALedgerOfALaterVersionIsRefusedByName) {
  store_.reset();
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "PRAGMA user_version=99", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  const absl::Status status = OpenSqliteJobStore(path_).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("schema 99"));
}

TEST(SqliteJobStoreOpen, WhatIsNoDatabaseIsNamed) {
  TempFolder folder;
  std::ofstream(folder.PathOf("ledger.db"))
      << "this is not a database, whatever its name says, and long enough to tell";
  const absl::Status status = OpenSqliteJobStore(folder.PathOf("ledger.db")).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(folder.PathOf("ledger.db")));
  EXPECT_EQ(OpenSqliteJobStore(folder.PathOf("none/ledger.db")).status().code(),
            absl::StatusCode::kUnavailable);
}

}  // namespace
}  // namespace lumifold::ledger
