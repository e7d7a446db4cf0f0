#include "server/ledger/postgres_job_store.h"
#include "proto/retry/storage_away.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "server/ledger/open_job_store.h"
#include "server/ledger/postgres_connection.h"
#include "tests/unit/ledger/job_store_fixture.h"
#include "tests/unit/ledger/old_schemas.h"
#include "tests/unit/ledger/postgres_database.h"

namespace lumifold::ledger {
namespace {

using absl::StatusCode;
using job::JobId;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr char kPassword[] = "secret/word";

class PostgresJobStoreTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string why_not;
    server_ = PostgresServer(&why_not);
    if (server_ == nullptr && why_not.find("not installed") != std::string::npos) GTEST_SKIP() << why_not;
    ASSERT_NE(server_, nullptr) << why_not;
    database_ = std::make_unique<PostgresDatabase>(server_->uri());
    store_ = *database_->Open();
  }

  PrivatePostgres* server_ = nullptr;
  std::unique_ptr<PostgresDatabase> database_;
  std::unique_ptr<JobStore> store_;
};

TEST_F(PostgresJobStoreTest, ACoordinatorThatIsCutOffWithinATransactionKeepsNobodyOut) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  const std::unique_ptr<PostgresConnection> cut_off = *PostgresConnection::Open(database_->uri());
  ASSERT_TRUE(cut_off->RunScript("BEGIN; SELECT * FROM jobs FOR UPDATE").ok());
  // It would wait for the lock no longer than lock_timeout.
  EXPECT_EQ(store_->CommitUnits({Commit("j-a", {Unit("j-a", 0, 0, 0)})}).status(), absl::OkStatus());
}

TEST_F(PostgresJobStoreTest, AServerThatGoesAwayIsUnavailableAndThenUsedAgain) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  const JobCommit commit = Commit("j-a", {Unit("j-a", 0, 0, 0)});
  server_->StopServer();
  for (const absl::Status& status :
       {store_->CommitUnits({commit}).status(), store_->GetJob(JobId("j-a")).status(),
        store_->NewEpoch().status(), database_->Open().status()}) {
    EXPECT_EQ(status.code(), StatusCode::kUnavailable);
    EXPECT_THAT(std::string(status.message()), HasSubstr("postgresql://"));
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr("secret")));
    EXPECT_EQ(retry::ForCaller(status),
              absl::UnavailableError(
                  "the storage of the farm is away, try again later: the database does not answer"));
  }
  server_->StartServer();
  EXPECT_TRUE(store_->CommitUnits({commit})->front().ok());
  EXPECT_EQ(store_->GetJob(JobId("j-a"))->done.units, 1);
  // A restart between two calls is not noticed.
  server_->StopServer();
  server_->StartServer();
  EXPECT_TRUE(store_->GetJob(JobId("j-a")).ok());
  EXPECT_TRUE(store_->CommitUnits({Commit("j-a", {Unit("j-a", 0, 1, 0)})})->front().ok());
}

TEST_F(PostgresJobStoreTest, AnErrorsClassSaysWhetherItIsTheStorages) {
  const std::vector<std::pair<std::string, StatusCode>> codes = {
      {"23505", StatusCode::kAlreadyExists},    // unique violation
      {"XX001", StatusCode::kDataLoss},         // a damaged table
      {"XX002", StatusCode::kDataLoss},         // a damaged index
      {"22021", StatusCode::kInvalidArgument},  // not UTF-8
      {"08006", StatusCode::kUnavailable},      // the connection failed
      {"28000", StatusCode::kUnavailable},      // no such login
      {"40001", StatusCode::kUnavailable},      // rolled back for another transaction
      {"53100", StatusCode::kUnavailable},      // disk full
      {"55P03", StatusCode::kUnavailable},      // lock not available
      {"57P01", StatusCode::kUnavailable},      // shutdown
      {"58030", StatusCode::kUnavailable},      // input or output error
      {"25006", StatusCode::kUnavailable},      // read-only
      {"25001", StatusCode::kInternal},         // a transaction within one
      {"42601", StatusCode::kInternal},         // a syntax error
      {"22003", StatusCode::kInternal},         // a number out of range
  };
  const std::unique_ptr<PostgresConnection> connection = *PostgresConnection::Open(database_->uri());
  for (const auto& [code, status] : codes) {
    const std::string script =
        absl::StrCat("DO $$ BEGIN RAISE EXCEPTION 'raised' USING ERRCODE = '", code, "'; END $$");
    EXPECT_EQ(connection->RunScript(script).code(), status) << code;
  }
}

TEST(StoreAddress, AnErrorThatQuotesThePasswordHidesIt) {
  const absl::Status refused =
      PostgresConnection::Open("host=127.0.0.1 port=1 dbname=farm password=hidden sslmode=hidden").status();
  EXPECT_THAT(std::string(refused.message()), HasSubstr("\"***\""));
  EXPECT_THAT(std::string(refused.message()), Not(HasSubstr("hidden")));
}

TEST_F(PostgresJobStoreTest, NoErrorHasThePassword) {
  const std::string wrong = absl::StrReplaceAll(server_->uri(), {{"secret%2Fword", "other%2Fsecret"}});
  const std::string malformed = absl::StrReplaceAll(server_->uri(), {{"@/farm", "@[/farm"}});
  ASSERT_NE(wrong, server_->uri());
  ASSERT_NE(malformed, server_->uri());
  const absl::Status refused = OpenJobStore(wrong, "").status();
  EXPECT_EQ(refused.code(), StatusCode::kUnavailable);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("password authentication failed"));
  const absl::Status unparsed = OpenJobStore(malformed, "").status();
  EXPECT_EQ(unparsed.code(), StatusCode::kInvalidArgument);
  const absl::Status other = OpenJobStore("mysql://u:secret@h/db", "").status();
  EXPECT_EQ(other.code(), StatusCode::kInvalidArgument);
  for (const absl::Status& status : {refused, unparsed, other}) {
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr("secret"))) << status;
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr(kPassword))) << status;
  }
}

TEST_F(PostgresJobStoreTest, TablesOfEarlierVersionsAreUpgraded) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  for (const int version : {6, 5, 4, 3}) {
    SCOPED_TRACE(version);
    const std::unique_ptr<PostgresConnection> db = *PostgresConnection::Open(database_->uri());
    ASSERT_TRUE(db->RunScript(kFromSchema7To6).ok());
    if (version <= 5) {
      ASSERT_TRUE(db->RunScript(kFromSchema6To5).ok());
    }
    if (version <= 4) {
      ASSERT_TRUE(db->RunScript(kFromSchema5To4).ok());
    }
    if (version == 3) {
      ASSERT_TRUE(db->RunScript(kFromSchema4To3).ok());
    }
    ASSERT_TRUE(db->SetSchemaVersion(version).ok());
    const absl::StatusOr<std::unique_ptr<JobStore>> store = database_->Open();
    ASSERT_TRUE(store.ok()) << store.status();
    EXPECT_EQ((*store)->GetJob(JobId("j-a"))->estimated_error, std::nullopt);
    EXPECT_TRUE((*store)->CommitUnits({Commit("j-a", {Unit("j-a", 0, version, 0)})})->front().ok());
    EXPECT_TRUE(db->RunScript("SELECT epoch, demand FROM coordinators").ok());
    EXPECT_EQ(*(*store)->deliveries().CountWaiting(), 0);
  }
  EXPECT_EQ((*database_->Open())->GetJob(JobId("j-a"))->done.units, 4);
}

TEST_F(PostgresJobStoreTest, TablesOfALaterVersionAreRefused) {
  ASSERT_TRUE((*PostgresConnection::Open(database_->uri()))->SetSchemaVersion(99).ok());
  const absl::Status status = database_->Open().status();
  EXPECT_EQ(status.code(), StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("schema 99"));
}

TEST_F(PostgresJobStoreTest, ABatchOfManyPipelinesIsRunInOrder) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  JobCommit commit = Commit("j-a", {});
  for (int tile = 0; tile < 3000; ++tile) commit.units.push_back(Unit("j-a", 0, tile, 0));
  ASSERT_TRUE(store_->CommitUnits({commit})->front().ok());
  int next = 0;
  ASSERT_TRUE(
      store_->ForEachUnit(JobId("j-a"), 0, [&](const UnitRecord& u) { EXPECT_EQ(u.unit.key.tile, next++); })
          .ok());
  EXPECT_EQ(next, 3000);
  EXPECT_EQ(*store_->PurgeUnits(10), 0);
}

TEST_F(PostgresJobStoreTest, TwoCoordinatorsOpenCreateAndCommitAtOnce) {
  const PostgresDatabase fresh(server_->uri());
  constexpr int kCoordinators = 4;
  constexpr int kCommits = 20;
  std::atomic<int> accepted = 0;
  std::vector<std::thread> threads;
  threads.reserve(kCoordinators);
  for (int i = 0; i < kCoordinators; ++i) {
    threads.emplace_back([&fresh, &accepted, i] {
      const absl::StatusOr<std::unique_ptr<JobStore>> store = OpenPostgresJobStore(fresh.uri());
      ASSERT_TRUE(store.ok()) << store.status();
      ASSERT_EQ(*(*store)->CreateJob(Job("j-a", "r-1")), JobId("j-a"));
      for (int tile = 0; tile < kCommits; ++tile) {
        UnitRecord unit = Unit("j-a", 0, tile, 0);
        unit.attempt = job::Attempt(unit.attempt.value() + i);  // each has rendered it
        absl::StatusOr<std::vector<absl::Status>> outcomes = absl::UnavailableError("not asked yet");
        // A machine that stands still for idle_in_transaction_session_timeout loses the transaction, as a
        // coordinator may.
        while (absl::IsUnavailable(outcomes.status()))
          outcomes = (*store)->CommitUnits({Commit("j-a", {unit})});
        ASSERT_TRUE(outcomes.ok()) << outcomes.status();
        if (outcomes->front().ok()) ++accepted;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(accepted, kCommits);
  EXPECT_EQ((*OpenPostgresJobStore(fresh.uri()))->GetJob(JobId("j-a"))->done.units, kCommits);
}

}  // namespace

}  // namespace lumifold::ledger
