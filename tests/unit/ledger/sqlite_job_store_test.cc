#include "server/ledger/sqlite_job_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "server/job/limits.h"
#include "server/ledger/sqlite_connection.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/ledger/job_store_fixture.h"
#include "tests/unit/ledger/old_schemas.h"

namespace lumifold::ledger {
namespace {

using absl::StatusCode;
using job::JobId;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class SqliteJobStoreTest : public ::testing::Test {
 protected:
  void RunSql(const std::string& sql) {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
  }
  std::unique_ptr<JobStore> Open() {
    absl::StatusOr<std::unique_ptr<JobStore>> store = OpenSqliteJobStore(path_);
    EXPECT_TRUE(store.ok()) << store.status();
    return store.ok() ? *std::move(store) : nullptr;
  }

  TempFolder folder_;
  const std::string path_ = folder_.PathOf("ledger.db");
};

TEST_F(SqliteJobStoreTest, ALedgerOfSchema2IsTakenOver) {
  RunSql(kSchema2);
  RunSql(kRowsOfSchema2);
  const std::unique_ptr<JobStore> store = Open();
  ASSERT_NE(store, nullptr);
  const Epoch epoch = *store->NewEpoch();
  // Its attempts were microseconds since 1970.
  EXPECT_GT(FirstAttempt(epoch), job::Attempt(absl::ToUnixMicros(absl::Now() + absl::Hours(24 * 365 * 50))));
  const ClaimedJobs claimed = *store->ClaimUnfinishedJobs({"new", epoch});
  ASSERT_THAT(claimed.jobs, SizeIs(1));
  const JobRecord& job = claimed.jobs[0];
  EXPECT_EQ(job.spec.width(), 640);
  EXPECT_EQ(job.spec.scene().display_name(), "room.glb");
  ASSERT_EQ(job.spec.scene().dependencies_size(), 1);
  EXPECT_EQ(job.spec.scene().dependencies(0).uri(), "wood.png");
  EXPECT_EQ(job.submitted, kStart);
  EXPECT_EQ(job.done.units, 3);
  EXPECT_EQ(job.done.frames, 1);
  EXPECT_EQ(job.times.filter_seconds(), 2.5);
  EXPECT_THAT(job.warnings, ElementsAre("no light", "no camera"));
  EXPECT_THAT(*store->FinishedFrames(JobId("j-a")), ElementsAre(0));
  std::vector<UnitRecord> units;
  ASSERT_TRUE(
      store->ForEachUnit(JobId("j-a"), std::nullopt, [&](const UnitRecord& u) { units.push_back(u); }).ok());
  ASSERT_THAT(units, SizeIs(2));
  EXPECT_EQ(Describe(units[1].unit), "j-a frame 1 tile 0 geometry");
  EXPECT_EQ(units[1].offset, 77u);
  ASSERT_TRUE(store->RevokeUnits({JobId("j-a"), epoch}, {units[1].unit.key}).ok());
  EXPECT_EQ(store->GetJob(JobId("j-a"))->done.samples, 200);
  // The same request is still the same job.
  NewJob again = Job("j-new", "r-1");
  again.spec = job.spec;
  again.scheduling.Clear();
  EXPECT_EQ(*store->CreateJob(again), JobId("j-a"));
  EXPECT_EQ(store->GetJob(JobId("j-ended"))->error, "broken");
  ASSERT_THAT(claimed.damaged, SizeIs(1));
  EXPECT_EQ(claimed.damaged[0].id, JobId("j-damaged"));
}

TEST_F(SqliteJobStoreTest, ALedgerOfSchema1IsTakenOverWithoutItsLongWarnings) {
  RunSql(absl::StrReplaceAll(kSchema2, {{",\n  warnings_left_out INTEGER NOT NULL DEFAULT 0", ""},
                                        {"user_version=2", "user_version=1"}}));
  RunSql(kRowsOfSchema2);
  std::string sql;
  for (int i = 0; i < 2 * job::kMaxJobWarnings; ++i)
    absl::StrAppend(&sql, "INSERT INTO warnings(job, line) VALUES(3, '", i, std::string(10'000, 'x'), "');");
  RunSql(sql);
  const std::unique_ptr<JobStore> store = Open();
  ASSERT_NE(store, nullptr);
  const JobRecord job = *store->GetJob(JobId("j-a"));
  EXPECT_EQ(job.spec.width(), 640);
  EXPECT_EQ(job.warnings.size(), size_t{job::kMaxJobWarnings});
  EXPECT_EQ(job.warnings.front(), "no light");
  EXPECT_EQ(job.warnings.back().size(), 512u);
  EXPECT_EQ(job.warnings_left_out, 0);
}

TEST_F(SqliteJobStoreTest, ADamagedRowIsAnErrorOfItsJobOnly) {
  const std::vector<std::string> damages = {
      "spec = x'ffff'",        "spec = 7",
      "files = x'ffff'",       "scheduling = x'ffff'",
      "units_done = 'many'",   "submitted_ms = x'00'",
      "error = x'00'",         "render_seconds = 'x'",
      "numeric_class = x'01'",
  };
  {
    const std::unique_ptr<JobStore> store = Open();
    ASSERT_TRUE(store->CreateJob(Job("j-good", "good")).ok());
    for (size_t i = 0; i < damages.size(); ++i) {
      const std::string id = absl::StrCat("j-", i);
      ASSERT_TRUE(store->CreateJob(Job(id, id)).ok());
    }
  }
  for (size_t i = 0; i < damages.size(); ++i)
    RunSql(absl::StrCat("UPDATE jobs SET ", damages[i], " WHERE id = 'j-", i, "'"));
  const std::unique_ptr<JobStore> store = Open();
  const ClaimedJobs claimed = *store->ClaimUnfinishedJobs({"next", Epoch(2)});
  ASSERT_THAT(claimed.jobs, SizeIs(1));
  EXPECT_EQ(claimed.jobs[0].id, JobId("j-good"));
  EXPECT_THAT(claimed.damaged, SizeIs(damages.size()));
  EXPECT_THAT(store->ListJobs({})->jobs, SizeIs(2));  // damaged files do not matter for a list
  EXPECT_THAT(store->ListJobs({})->damaged, SizeIs(damages.size() - 1));
  for (size_t i = 0; i < damages.size(); ++i) {
    const JobId id(absl::StrCat("j-", i));
    const absl::Status status = store->GetJob(id).status();
    EXPECT_EQ(status.code(), StatusCode::kInternal) << damages[i];
    EXPECT_THAT(std::string(status.message()), HasSubstr(id.value()));
    EXPECT_TRUE(store->EndJob({id, Epoch(2)}, {v1::JOB_STATE_FAILED, "damaged"}).ok());
    EXPECT_TRUE(store->DeleteJob(id).ok());
  }
  EXPECT_THAT(store->ListJobs({})->damaged, IsEmpty());
}

TEST_F(SqliteJobStoreTest, ACallThatWritesToAJobWhoseOwnerIsDamagedNamesIt) {
  ASSERT_TRUE(Open()->CreateJob(Job("j-a", "r-1")).ok());
  RunSql("UPDATE jobs SET epoch = 'x'");
  const absl::Status status = Open()->SetScheduling({JobId("j-a"), Epoch(1)}, {});
  EXPECT_EQ(status.code(), StatusCode::kInternal);
  EXPECT_THAT(std::string(status.message()), HasSubstr("j-a"));
}

TEST_F(SqliteJobStoreTest, ADamagedRowOfAUnitIsAnErrorOfItsJobOnly) {
  {
    const std::unique_ptr<JobStore> store = Open();
    for (const char* id : {"j-a", "j-b"}) {
      ASSERT_TRUE(store->CreateJob(Job(id, id)).ok());
      ASSERT_TRUE(store->CommitUnits({Commit(id, {Unit(id, 0, 0, 0)})})->front().ok());
    }
  }
  RunSql("UPDATE units SET position = 'x' WHERE film = 1");
  const std::unique_ptr<JobStore> store = Open();
  const auto ignore = [](const UnitRecord&) {};
  EXPECT_EQ(store->ForEachUnit(JobId("j-a"), std::nullopt, ignore).code(), StatusCode::kInternal);
  EXPECT_TRUE(store->ForEachUnit(JobId("j-b"), std::nullopt, ignore).ok());
}

TEST_F(SqliteJobStoreTest, AValueOfAnotherTypeThanWasAskedForIsNotReadable) {
  const std::unique_ptr<SqliteConnection> connection = *SqliteConnection::Open(path_);
  const std::vector<std::function<void(SqlRow&)>> readers = {
      [](SqlRow& row) { row.Int(); }, [](SqlRow& row) { row.Real(); }, [](SqlRow& row) { row.Text(); },
      [](SqlRow& row) { row.Bytes(); }};
  const std::vector<std::string> values = {"7", "1.5", "'oak'", "x'6f'", "NULL"};
  for (size_t value = 0; value < values.size(); ++value) {
    for (size_t reader = 0; reader < readers.size(); ++reader) {
      ASSERT_TRUE(connection
                      ->Query("SELECT " + values[value], {},
                              [&](SqlRow& row) {
                                readers[reader](row);
                                EXPECT_EQ(row.is_readable(), value == reader) << values[value];
                              })
                      .ok());
    }
  }
}

TEST_F(SqliteJobStoreTest, PurgedRowsAndDeletedJobsLeaveNothing) {
  const std::unique_ptr<JobStore> store = Open();
  ASSERT_TRUE(store->CreateJob(Job("j-a", "r-1")).ok());
  JobCommit commit = Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 1, 0, 0)});
  commit.warnings = {"no light"};
  ASSERT_TRUE(store->CommitUnits({commit})->front().ok());
  ASSERT_TRUE(store->RecordFrame(Owned("j-a"), 0, {}).ok());
  ASSERT_TRUE(store->EndJob(Owned("j-a"), {v1::JOB_STATE_DONE, ""}).ok());
  ASSERT_TRUE(store->DeleteJob(JobId("j-a")).ok());
  ASSERT_EQ(*store->PurgeUnits(100), 0);
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
  int64_t rows = -1;
  ASSERT_EQ(
      sqlite3_exec(
          db,
          "SELECT (SELECT COUNT(*) FROM jobs) + (SELECT COUNT(*) FROM films) + (SELECT COUNT(*) FROM units)"
          " + (SELECT COUNT(*) FROM garbage) + (SELECT COUNT(*) FROM workers)"
          " + (SELECT COUNT(*) FROM warnings)",
          [](void* sum, int, char** columns, char**) {
            *static_cast<int64_t*>(sum) = std::stoll(columns[0]);
            return 0;
          },
          &rows, nullptr),
      SQLITE_OK);
  sqlite3_close(db);
  EXPECT_EQ(rows, 0);
}

TEST_F(SqliteJobStoreTest, ALedgerOfSchema3GetsTheColumnOfErrors) {
  ASSERT_TRUE(Open()->CreateJob(Job("j-a", "r-1")).ok());
  RunSql(kFromSchema7To6);
  RunSql(kFromSchema6To5);
  RunSql(kFromSchema5To4);
  RunSql(kFromSchema4To3);
  RunSql("PRAGMA user_version=3");
  const std::unique_ptr<JobStore> store = Open();
  ASSERT_NE(store, nullptr);
  EXPECT_EQ(store->GetJob(JobId("j-a"))->estimated_error, std::nullopt);
  v1::FrameReport report;
  report.set_estimated_error(0.5);
  ASSERT_TRUE(store->RecordFrame(Owned("j-a"), 0, report).ok());
  EXPECT_EQ(store->GetJob(JobId("j-a"))->estimated_error, 0.5);
}

TEST_F(SqliteJobStoreTest, ALedgerOfSchema4GetsTheRoster) {
  ASSERT_TRUE(Open()->CreateJob(Job("j-a", "r-1")).ok());
  RunSql(kFromSchema7To6);
  RunSql(kFromSchema6To5);
  RunSql(kFromSchema5To4);
  RunSql("PRAGMA user_version=4");
  const std::unique_ptr<JobStore> store = Open();
  ASSERT_NE(store, nullptr);
  EXPECT_EQ(store->GetJob(JobId("j-a"))->estimated_error, std::nullopt);
  RunSql("SELECT epoch, demand FROM coordinators");
}

TEST_F(SqliteJobStoreTest, ALedgerOfSchema5GetsItsUsage) {
  ASSERT_TRUE(Open()->CreateJob(Job("j-a", "r-1")).ok());
  RunSql(kFromSchema7To6);
  RunSql(kFromSchema6To5);
  RunSql("PRAGMA user_version=5");
  const std::unique_ptr<JobStore> store = Open();
  ASSERT_NE(store, nullptr);
  EXPECT_EQ(store->GetJob(JobId("j-a"))->counted, job::Attempt(0));
  EXPECT_TRUE(store->Usage({.since = absl::UnixEpoch(), .until = absl::UnixEpoch()}).ok());
}

TEST_F(SqliteJobStoreTest, ALedgerOfSchema6GetsItsDeliveries) {
  ASSERT_TRUE(Open()->CreateJob(Job("j-a", "r-1")).ok());
  RunSql(kFromSchema7To6);
  RunSql("PRAGMA user_version=6");
  const std::unique_ptr<JobStore> store = Open();
  ASSERT_NE(store, nullptr);
  EXPECT_EQ(*store->deliveries().CountWaiting(), 0);
}

TEST_F(SqliteJobStoreTest, ALedgerOfALaterVersionIsRefusedByName) {
  RunSql("PRAGMA user_version=99");
  const absl::Status status = OpenSqliteJobStore(path_).status();
  EXPECT_EQ(status.code(), StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("schema 99"));
}

TEST_F(SqliteJobStoreTest, WhatIsNoDatabaseIsDataLossAndWhatCannotBeOpenedIsUnavailable) {
  std::ofstream(path_) << "this is not a database, whatever its name says, and long enough to tell";
  const absl::Status status = OpenSqliteJobStore(path_).status();
  EXPECT_EQ(status.code(), StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), HasSubstr(path_));
  const absl::Status missing = OpenSqliteJobStore(folder_.PathOf("none/ledger.db")).status();
  EXPECT_EQ(missing.code(), StatusCode::kUnavailable);
  EXPECT_THAT(std::string(missing.message()), HasSubstr("No such file or directory"));
}

TEST_F(SqliteJobStoreTest, AMalformedPageIsDataLoss) {
  {
    const std::unique_ptr<JobStore> store = Open();
    for (int i = 0; i < 200; ++i) {
      const std::string id = absl::StrCat("j-", i);
      ASSERT_TRUE(store->CreateJob(Job(id, id)).ok());
    }
  }
  const std::string original = [this] {
    std::ifstream file(path_, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  }();
  constexpr size_t kPage = 4096;
  std::string damaged = original;
  for (size_t at = kPage; at + kPage <= damaged.size(); at += kPage) damaged.replace(at, 100, 100, '\xff');
  std::ofstream(path_, std::ios::binary) << damaged;
  const absl::StatusOr<std::unique_ptr<JobStore>> store = OpenSqliteJobStore(path_);
  const absl::Status status = store.ok() ? (*store)->ListJobs({}).status() : store.status();
  EXPECT_EQ(status.code(), StatusCode::kDataLoss) << status;
}

}  // namespace
}  // namespace lumifold::ledger
