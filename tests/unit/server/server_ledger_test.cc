// What a coordinator makes of its ledger.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "tests/unit/server/farm_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class ServerLedgerTest : public FarmFixture {
 protected:
  void RunSql(const std::string& sql) {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(folder_.PathOf("data/ledger.db").c_str(), &db), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
  }
  std::pair<grpc::Status, v1::ListJobsResponse> List(const v1::ListJobsRequest& request) {
    std::pair<grpc::Status, v1::ListJobsResponse> answer;
    grpc::ClientContext context;
    answer.first = v1::FarmService::NewStub(Channel())->ListJobs(&context, request, &answer.second);
    return answer;
  }
  static std::vector<std::string> Ids(const v1::ListJobsResponse& response) {
    std::vector<std::string> ids;
    for (const v1::JobStatus& job : response.jobs()) ids.push_back(job.job_id());
    return ids;
  }
};

TEST_F(ServerLedgerTest, ADamagedRowFailsItsJobAndTheOthersGoOn) {
  const std::string damaged = *Submit(Spec(), "damaged");
  const std::string good = *Submit(Spec(), "good");
  StopServer();
  RunSql(absl::StrCat("UPDATE jobs SET spec = x'ffff' WHERE id = '", damaged, "'"));
  StartServer();
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(good).state(), v1::JOB_STATE_DONE);
  const auto [status, response] = List({});
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(response.jobs_size(), 2);
  EXPECT_EQ(response.jobs(0).job_id(), good);
  EXPECT_EQ(response.jobs(1).job_id(), damaged);
  EXPECT_EQ(response.jobs(1).state(), v1::JOB_STATE_FAILED);
  EXPECT_THAT(response.jobs(1).error(), HasSubstr(damaged));
}

TEST_F(ServerLedgerTest, JobsAreListedInPagesByStateAndUser) {
  std::vector<std::string> jobs;
  for (int i = 0; i < 5; ++i) jobs.push_back(*Submit(Spec(), absl::StrCat("request-", i)));
  grpc::ClientContext context;
  v1::CancelJobRequest cancel;
  cancel.set_job_id(jobs[2]);
  v1::JobStatus cancelled;
  ASSERT_TRUE(v1::FarmService::NewStub(Channel())->CancelJob(&context, cancel, &cancelled).ok());

  v1::ListJobsRequest request;
  request.set_limit(2);
  const v1::ListJobsResponse first = List(request).second;
  EXPECT_THAT(Ids(first), ElementsAre(jobs[4], jobs[3]));
  request.set_page_token(first.next_page_token());
  const v1::ListJobsResponse second = List(request).second;
  EXPECT_THAT(Ids(second), ElementsAre(jobs[2], jobs[1]));
  request.set_page_token(second.next_page_token());
  const v1::ListJobsResponse last = List(request).second;
  EXPECT_THAT(Ids(last), ElementsAre(jobs[0]));
  EXPECT_EQ(last.next_page_token(), "");

  // The ledger does not tell the states of active jobs apart: a page is filled all the same.
  v1::ListJobsRequest active;
  active.set_limit(3);
  active.add_states(v1::JOB_STATE_PLANNED);
  EXPECT_THAT(Ids(List(active).second), ElementsAre(jobs[4], jobs[3], jobs[1]));
  active.clear_states();
  active.add_states(v1::JOB_STATE_RUNNING);
  EXPECT_THAT(Ids(List(active).second), IsEmpty());
  active.add_states(v1::JOB_STATE_CANCELLED);
  EXPECT_THAT(Ids(List(active).second), ElementsAre(jobs[2]));
  // A page of the ledger may hold fewer jobs in a state than the limit: it is read on until there are as
  // many, and no more.
  jobs.push_back(*Submit(Spec(), "request-5"));
  for (const size_t i : {0u, 5u}) {
    v1::PauseJobRequest pause;
    pause.set_job_id(jobs[i]);
    grpc::ClientContext pausing;
    v1::JobStatus status;
    ASSERT_TRUE(v1::FarmService::NewStub(Channel())->PauseJob(&pausing, pause, &status).ok());
  }
  active.Clear();
  active.add_states(v1::JOB_STATE_PLANNED);
  active.set_limit(2);
  const v1::ListJobsResponse planned = List(active).second;
  EXPECT_THAT(Ids(planned), ElementsAre(jobs[4], jobs[3]));
  active.set_page_token(planned.next_page_token());
  EXPECT_THAT(Ids(List(active).second), ElementsAre(jobs[1]));
  active.clear_page_token();
  active.set_states(0, v1::JOB_STATE_PAUSED);
  EXPECT_THAT(Ids(List(active).second), ElementsAre(jobs[5], jobs[0]));
  active.set_limit(1);
  const v1::ListJobsResponse paused = List(active).second;
  EXPECT_THAT(Ids(paused), ElementsAre(jobs[5]));
  active.set_page_token(paused.next_page_token());
  EXPECT_THAT(Ids(List(active).second), ElementsAre(jobs[0]));
  active.Clear();
  active.set_user("anonymous");
  EXPECT_THAT(Ids(List(active).second), SizeIs(6));
  active.set_user("somebody");
  EXPECT_THAT(Ids(List(active).second), IsEmpty());

  v1::ListJobsRequest wrong;
  wrong.set_page_token("abc");
  EXPECT_EQ(List(wrong).first.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(List(wrong).first.error_message(), HasSubstr("page_token \"abc\""));
}

TEST_F(ServerLedgerTest, ARequestIdOfAnotherSpecIsRefused) {
  const std::string job = *Submit(Spec(), "request");
  EXPECT_EQ(*Submit(Spec(), "request"), job);
  v1::JobSpec other = Spec();
  other.set_seed(other.seed() + 1);
  const absl::Status status = Submit(other, "request").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kAlreadyExists);
  EXPECT_THAT(std::string(status.message()), HasSubstr(job));
}

}  // namespace
}  // namespace lumifold::server
