// The ledger on storage that fails: every call of a history, one after the other, is made to fail.
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/ledger/sql_job_store.h"
#include "server/ledger/sqlite_connection.h"
#include "server/ledger/sqlite_job_store.h"
#include "tests/support/faulty_vfs.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/ledger/history.h"
#include "tests/unit/ledger/memory_job_store.h"
#include "tests/unit/ledger/old_schemas.h"

namespace lumifold::ledger {
namespace {

using Fault = FaultyVfs::Fault;
using Survivors = FaultyVfs::Survivors;

/// The ledger is closed and opened before these steps, so that its log is written back into the database.
constexpr size_t kReopenBefore = 5;
constexpr int kMaxTries = 4;

/// A history, and what each of its states must be: states[i] before step i.
struct Expected {
  std::vector<Step> history = ShortHistory();
  std::vector<std::string> states;

  Expected() {
    const std::unique_ptr<JobStore> model = MakeMemoryJobStore(MakeMemoryState());
    states.push_back(Dump(*model));
    for (const Step& step : history) {
      EXPECT_TRUE(step.run(*model).ok());
      states.push_back(Dump(*model));
    }
  }
};

std::string IntegrityOf(const std::string& path) {
  sqlite3* db = nullptr;
  EXPECT_EQ(sqlite3_open(path.c_str(), &db), SQLITE_OK);
  std::string answer;
  sqlite3_exec(
      db, "PRAGMA integrity_check",
      [](void* text, int, char** columns, char**) {
        *static_cast<std::string*>(text) += columns[0];
        return 0;
      },
      &answer, nullptr);
  sqlite3_close(db);
  return answer;
}

/// A connection one of whose statements fails without reaching the database.
class FailingConnection final : public SqlConnection {
 public:
  /// `*left`: the number of the statement that fails, from 1, of all connections that share it; 0 afterwards.
  FailingConnection(std::unique_ptr<SqlConnection> connection, int64_t* left)
      : connection_(std::move(connection)), left_(left) {}

  const SqlDialect& dialect() const override { return connection_->dialect(); }
  absl::Status RunScript(const std::string& sql) override {
    return sql != "ROLLBACK" && Fails() ? Error() : connection_->RunScript(sql);
  }
  absl::StatusOr<int64_t> SchemaVersion() override { return connection_->SchemaVersion(); }
  absl::Status SetSchemaVersion(int64_t version) override { return connection_->SetSchemaVersion(version); }

 private:
  absl::Status RunChecked(const std::string& sql, absl::Span<const SqlParams> batch, Visit visit) override {
    return Fails() ? Error() : connection_->RunBatch(sql, batch, visit);
  }
  bool Fails() { return *left_ > 0 && --*left_ == 0; }
  static absl::Status Error() { return absl::UnavailableError("as a test wants it"); }

  const std::unique_ptr<SqlConnection> connection_;
  int64_t* const left_;
};

class SqliteFaultTest : public ::testing::Test {
 protected:
  /// Runs steps from `first` on until the end, or until one of them fails `tries` times; returns how many
  /// were done.
  size_t RunFrom(size_t first, int tries) {
    for (size_t i = first; i < expected_.history.size(); ++i) {
      if (i % kReopenBefore == 0) store_.reset();
      bool is_done = false;
      for (int t = 0; t < tries && !is_done; ++t) is_done = RunStep(expected_.history[i]);
      if (!is_done) return i;
    }
    return expected_.history.size();
  }

  bool RunStep(const Step& step) {
    if (store_ == nullptr) {
      absl::StatusOr<std::unique_ptr<JobStore>> store = OpenSqliteJobStore(path_);
      if (!store.ok()) {
        EXPECT_TRUE(absl::IsUnavailable(store.status())) << store.status();
        return false;
      }
      store_ = *std::move(store);
    }
    const absl::Status status = step.run(*store_).status();
    EXPECT_TRUE(status.ok() || absl::IsUnavailable(status)) << step.name << ": " << status;
    return status.ok();
  }

  void Clear() {
    store_.reset();
    for (const char* suffix : {"", "-wal", "-shm"}) std::filesystem::remove(path_ + suffix);
    vfs_ = nullptr;
    vfs_ = std::make_unique<FaultyVfs>();
  }

  void WriteLedgerOfSchema2() {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
    for (const char* sql : {kSchema2, kRowsOfSchema2})
      EXPECT_EQ(sqlite3_exec(db, sql, nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
  }

  /// An error at each call in turn: what is tried again succeeds, and nothing is lost or done twice.
  void FailEachCall(Fault fault) {
    for (int64_t call = 1;; ++call) {
      SCOPED_TRACE(absl::StrCat("call ", call));
      Clear();
      vfs_->FailAt(call, fault);
      ASSERT_EQ(RunFrom(0, kMaxTries), expected_.history.size());
      const bool has_failed = vfs_->has_failed();
      vfs_->FailAt(0, Fault::kNone);
      if (store_ != nullptr) {
        ASSERT_EQ(Dump(*store_), expected_.states.back());
      }
      store_.reset();
      ASSERT_EQ(IntegrityOf(path_), "ok");
      ASSERT_EQ(Dump(**OpenSqliteJobStore(path_)), expected_.states.back());
      if (!has_failed) {
        EXPECT_GT(call, 50);
        return;
      }
    }
  }

  /// A power cut at each change of a file in turn: what was acknowledged is there, what was not is there
  /// wholly or not at all, and the history goes on.
  void CutPowerAtEachCall(Survivors survivors) {
    for (int64_t call = 1;; ++call) {
      SCOPED_TRACE(absl::StrCat("call ", call));
      Clear();
      vfs_->FailAt(call, Fault::kPowerCut);
      const size_t done = RunFrom(0, 1);
      const bool has_failed = vfs_->has_failed();
      store_.reset();
      vfs_->Restore(survivors);
      absl::StatusOr<std::unique_ptr<JobStore>> store = OpenSqliteJobStore(path_);
      ASSERT_TRUE(store.ok()) << store.status();
      store_ = *std::move(store);
      const std::string state = Dump(*store_);
      if (state != expected_.states[done]) {
        ASSERT_LT(done, expected_.history.size());
        ASSERT_EQ(state, expected_.states[done + 1]) << "after step " << done;
      }
      ASSERT_EQ(IntegrityOf(path_), "ok");
      ASSERT_EQ(RunFrom(done, 1), expected_.history.size());
      ASSERT_EQ(Dump(*store_), expected_.states.back());
      if (!has_failed) {
        EXPECT_GT(call, 50);
        return;
      }
    }
  }

  const Expected expected_;
  TempFolder folder_;
  const std::string path_ = folder_.PathOf("ledger.db");
  std::unique_ptr<FaultyVfs> vfs_ = std::make_unique<FaultyVfs>();
  std::unique_ptr<JobStore> store_;  // destroyed before the file system
};

TEST_F(SqliteFaultTest, APowerCutAtEachCallOfAnUpgrade) {
  std::string expected;
  for (int64_t call = 0;; ++call) {  // 0: none
    SCOPED_TRACE(absl::StrCat("call ", call));
    Clear();
    WriteLedgerOfSchema2();
    vfs_->FailAt(call, call == 0 ? Fault::kNone : Fault::kPowerCut);
    (void)OpenSqliteJobStore(path_);
    const bool has_failed = vfs_->has_failed();
    vfs_->Restore(call % 2 == 0 ? Survivors::kEveryOther : Survivors::kAllButHalfOfTheLast);
    const absl::StatusOr<std::unique_ptr<JobStore>> store = OpenSqliteJobStore(path_);
    ASSERT_TRUE(store.ok()) << store.status();
    ASSERT_EQ(IntegrityOf(path_), "ok");
    const std::string state = Dump(**store);
    if (call == 0) {
      expected = state;
      EXPECT_NE(state.find("j-a"), std::string::npos);
    } else if (!has_failed) {
      EXPECT_GT(call, 10);
      return;
    }
    ASSERT_EQ(state, expected);
  }
}

TEST_F(SqliteFaultTest, AnErrorOfEachStatementIsThatOfItsCallWhichDoesNothing) {
  for (int64_t statement = 1;; ++statement) {
    SCOPED_TRACE(absl::StrCat("statement ", statement));
    Clear();
    ASSERT_TRUE(OpenSqliteJobStore(path_).ok());  // makes the tables
    int64_t left = statement;
    const auto open = [&] {
      return std::make_unique<FailingConnection>(*SqliteConnection::Open(path_), &left);
    };
    store_ = MakeSqlJobStore(open(), open());
    for (size_t i = 0; i < expected_.history.size(); ++i) {
      const Step& step = expected_.history[i];
      const bool may_fail = left > 0;
      absl::Status status = step.run(*store_).status();
      if (may_fail && left == 0) {
        EXPECT_TRUE(absl::IsUnavailable(status)) << step.name << ": " << status;
        EXPECT_EQ(Dump(*store_), expected_.states[i]) << step.name;
        status = step.run(*store_).status();
      }
      ASSERT_TRUE(status.ok()) << step.name << ": " << status;
    }
    const bool has_failed = left == 0;
    left = 0;
    ASSERT_EQ(Dump(*store_), expected_.states.back());
    if (!has_failed) {
      EXPECT_GT(statement, 50);
      return;
    }
  }
}

TEST_F(SqliteFaultTest, NoSpaceAtEachCall) { FailEachCall(Fault::kNoSpace); }

TEST_F(SqliteFaultTest, AnInputOutputErrorAtEachCall) { FailEachCall(Fault::kInputOutput); }

TEST_F(SqliteFaultTest, NoMemoryAtEachCall) { FailEachCall(Fault::kNoMemory); }

TEST_F(SqliteFaultTest, APowerCutThatKeepsWhatWasSynced) { CutPowerAtEachCall(Survivors::kNone); }

TEST_F(SqliteFaultTest, APowerCutThatKeepsTheFirstUnsyncedWrites) {
  CutPowerAtEachCall(Survivors::kFirstHalf);
}

TEST_F(SqliteFaultTest, APowerCutThatTearsTheLastWrite) {
  CutPowerAtEachCall(Survivors::kAllButHalfOfTheLast);
}

TEST_F(SqliteFaultTest, APowerCutThatKeepsEveryOtherWrite) { CutPowerAtEachCall(Survivors::kEveryOther); }

}  // namespace
}  // namespace lumifold::ledger
