// Who may do what with whose job.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "absl/strings/str_cat.h"
#include "proto/rpc/version.h"
#include "server/access/authorisation.h"
#include "server/coordinator/job_status.h"
#include "tests/unit/server/gate_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::UnorderedElementsAre;
using Stub = v1::FarmService::Stub;

constexpr char kOwnerAnn[] = "person/ann/submit";
constexpr char kOwnerBob[] = "person/bob/submit";
constexpr char kReader[] = "person/ann/read";
constexpr char kAdmin[] = "person/root/admin";

/// How the metadata names a caller of this role.
std::string CallerOf(access::Role role) {
  switch (role) {
    case access::Role::kNobody:
      return "";
    case access::Role::kWorker:
      return "worker/node-7";
    case access::Role::kLocal:
      return "local";
    default:
      return absl::StrCat("person/ann/", access::NameOf(role));
  }
}

class OwnershipTest : public GateFixture {
 protected:
  OwnershipTest() {
    StartGate();
    StoreScene();
  }

  std::string Submitted(const std::string& caller) {
    std::string job;
    const grpc::Status status = SubmitAs(caller, absl::StrCat("request-", ++requests_), "", &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }

  template <typename Request, typename Response>
  grpc::Status OfJob(const std::string& caller, const std::string& job,
                     grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*)) {
    Request request;
    request.set_job_id(job);
    Response response;
    return Call(caller, method, request, &response);
  }

  grpc::Status Watch(const std::string& caller, const std::string& job) {
    const auto context = As(caller);
    v1::WatchJobRequest request;
    request.set_job_id(job);
    const auto reader = farm().WatchJob(context.get(), request);
    v1::JobStatus status;
    if (!reader->Read(&status)) return reader->Finish();
    context->TryCancel();
    reader->Finish();
    return grpc::Status::OK;
  }

  grpc::Status Download(const std::string& caller, const std::string& job) {
    const auto context = As(caller);
    v1::DownloadResultRequest request;
    request.set_job_id(job);
    const auto reader = farm().DownloadResult(context.get(), request);
    v1::ByteChunk chunk;
    while (reader->Read(&chunk)) {
    }
    return reader->Finish();
  }

  /// The answers of all calls about one job, by name.
  std::map<std::string, grpc::Status> AllOfJob(const std::string& caller, const std::string& job) {
    std::map<std::string, grpc::Status> answers;
    answers["GetJob"] = OfJob(caller, job, &Stub::GetJob);
    answers["ExplainJob"] = OfJob(caller, job, &Stub::ExplainJob);
    answers["GetLog"] = OfJob(caller, job, &Stub::GetLog);
    answers["GetPreview"] = OfJob(caller, job, &Stub::GetPreview);
    answers["WatchJob"] = Watch(caller, job);
    answers["DownloadResult"] = Download(caller, job);
    answers["PauseJob"] = OfJob(caller, job, &Stub::PauseJob);
    answers["ResumeJob"] = OfJob(caller, job, &Stub::ResumeJob);
    answers["SetJobPriority"] = OfJob(caller, job, &Stub::SetJobPriority);
    answers["AddSamples"] = OfJob(caller, job, &Stub::AddSamples);
    answers["RetryJob"] = OfJob(caller, job, &Stub::RetryJob);
    answers["CancelJob"] = OfJob(caller, job, &Stub::CancelJob);
    answers["DeleteJob"] = OfJob(caller, job, &Stub::DeleteJob);
    return answers;
  }

  std::set<std::string> Listed(const std::string& caller, const std::string& user = "", int limit = 0) {
    std::set<std::string> jobs;
    v1::ListJobsRequest request;
    request.set_user(user);
    request.set_limit(limit);
    v1::ListJobsResponse response;
    do {
      EXPECT_TRUE(Call(caller, &Stub::ListJobs, request, &response).ok());
      EXPECT_TRUE(limit == 0 || response.jobs_size() <= limit);
      for (const v1::JobStatus& job : response.jobs()) jobs.insert(job.job_id());
      request.set_page_token(response.next_page_token());
    } while (!response.next_page_token().empty());
    return jobs;
  }

  int requests_ = 0;
};

// Every cell of the table, through the services. What the health, reflection and access services answer is
// tested where they are served.
TEST_F(OwnershipTest, EachCellOfTheTableHolds) {
  int cells = 0;
  for (const access::Rule& rule : access::Rules()) {
    if (rule.rpc_path.find("FarmService") == std::string::npos &&
        rule.rpc_path.find("WorkerService") == std::string::npos)
      continue;
    for (const access::Role role : access::kRoles) {
      const grpc::StatusCode code = CallByPath(CallerOf(role), std::string(rule.rpc_path)).error_code();
      const bool refused =
          code == grpc::StatusCode::PERMISSION_DENIED || code == grpc::StatusCode::UNAUTHENTICATED;
      const access::Access access = access::AccessOf(role, rule.rpc_path);
      // A worker without a lease may call FetchSpec, and is told that it has none.
      const bool by_lease =
          access == access::Access::kYes && rule.rpc_path.find("/Fetch") != std::string::npos;
      EXPECT_TRUE(by_lease || refused == (access == access::Access::kNo))
          << rule.rpc_path << " " << access::NameOf(role);
      EXPECT_NE(code, grpc::StatusCode::UNIMPLEMENTED) << rule.rpc_path;
      ++cells;
    }
  }
  EXPECT_EQ(cells, 30 * 6);
}

TEST_F(OwnershipTest, AJobOfSomebodyElseDoesNotExist) {
  const std::string job = Submitted(kOwnerBob);
  const auto of_ann = AllOfJob(kOwnerAnn, job);
  const auto missing = AllOfJob(kOwnerAnn, std::string(job.size(), 'x'));
  for (const auto& [name, answer] : of_ann) {
    EXPECT_EQ(answer.error_code(), grpc::StatusCode::NOT_FOUND) << name << " " << answer.error_message();
    EXPECT_EQ(answer.error_message(), absl::StrCat("no job ", job)) << name;
    EXPECT_EQ(missing.at(name).error_message(), absl::StrCat("no job ", std::string(job.size(), 'x')))
        << name;
  }
  EXPECT_TRUE(OfJob(kOwnerBob, job, &Stub::GetJob).ok()) << "it was changed";
}

TEST_F(OwnershipTest, OwnersAndAdminsReachIt) {
  for (const std::string caller : {kOwnerBob, kAdmin, "local"}) {
    const std::string job = Submitted(kOwnerBob);
    for (const auto& [name, answer] : AllOfJob(caller, job)) {
      EXPECT_NE(answer.error_code(), grpc::StatusCode::NOT_FOUND) << caller << " " << name;
      EXPECT_NE(answer.error_code(), grpc::StatusCode::PERMISSION_DENIED) << caller << " " << name;
    }
    EXPECT_EQ(OfJob(kOwnerBob, job, &Stub::GetJob).error_code(), grpc::StatusCode::NOT_FOUND)
        << "it is deleted";
  }
}

TEST_F(OwnershipTest, AReadTokenChangesNothing) {
  const std::string job = Submitted(kOwnerAnn);
  EXPECT_EQ(SubmitAs(kReader, "by a reader", "", nullptr).error_code(), grpc::StatusCode::PERMISSION_DENIED);
  for (const auto& [name, answer] : AllOfJob(kReader, job)) {
    const bool may = access::AccessOf(access::Role::kRead, absl::StrCat("/lumifold.v1.FarmService/", name)) !=
                     access::Access::kNo;
    EXPECT_EQ(answer.error_code() == grpc::StatusCode::PERMISSION_DENIED, !may) << name;
  }
}

TEST_F(OwnershipTest, AJobBelongsToItsSubmitter) {
  std::string job;
  ASSERT_TRUE(SubmitAs(kOwnerAnn, "own", "ann", &job).ok());
  EXPECT_EQ(*coordinator_->jobs().UserOf(job), "ann");
  EXPECT_EQ(*coordinator_->jobs().UserOf(Submitted(kOwnerAnn)), "ann");
  const grpc::Status refused = SubmitAs(kOwnerAnn, "for bob", "bob", nullptr);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_THAT(refused.error_message(), HasSubstr("scheduling.user is \"bob\""));
  ASSERT_TRUE(SubmitAs(kAdmin, "for bob", "bob", &job).ok());
  EXPECT_EQ(*coordinator_->jobs().UserOf(job), "bob");
  EXPECT_EQ(*coordinator_->jobs().UserOf(Submitted("local")), "anonymous");
}

TEST_F(OwnershipTest, ARequestIdOfSomebodyElseGivesNoJob) {
  std::string job;
  ASSERT_TRUE(SubmitAs(kOwnerBob, "guessed", "", &job).ok());
  std::string other;
  EXPECT_EQ(SubmitAs(kOwnerAnn, "guessed", "", &other).error_code(), grpc::StatusCode::ALREADY_EXISTS);
  EXPECT_EQ(other, "");
}

TEST_F(OwnershipTest, AJobWaitsForOwnJobsOnly) {
  const std::string of_bob = Submitted(kOwnerBob);
  v1::SubmitJobRequest request;
  *request.mutable_spec() = Spec();
  request.set_request_id("waits");
  request.mutable_scheduling()->add_after(of_bob);
  v1::SubmitJobResponse response;
  const grpc::Status refused = Call(kOwnerAnn, &Stub::SubmitJob, request, &response);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(refused.error_message(), absl::StrCat("scheduling.after: there is no job \"", of_bob, "\""));
  EXPECT_TRUE(Call(kOwnerBob, &Stub::SubmitJob, request, &response).ok());
}

TEST_F(OwnershipTest, AListHasOwnJobsInFullPages) {
  std::set<std::string> of_ann;
  std::set<std::string> all;
  for (int i = 0; i < 5; ++i) {
    of_ann.insert(Submitted(kOwnerAnn));
    for (int j = 0; j < 3; ++j) all.insert(Submitted(kOwnerBob));
  }
  all.insert(of_ann.begin(), of_ann.end());
  for (const int limit : {0, 1, 2, 5}) EXPECT_EQ(Listed(kOwnerAnn, "", limit), of_ann) << limit;
  EXPECT_EQ(Listed(kReader, "ann"), of_ann);
  EXPECT_THAT(Listed(kOwnerAnn, "bob"), IsEmpty());
  EXPECT_EQ(Listed(kAdmin, "ann"), of_ann);
  EXPECT_THAT(Listed(kAdmin), testing::IsSupersetOf(all));
  v1::ListJobsRequest request;
  request.set_limit(2);
  v1::ListJobsResponse response;
  ASSERT_TRUE(Call(kOwnerAnn, &Stub::ListJobs, request, &response).ok());
  EXPECT_EQ(response.jobs_size(), 2) << "a page is full although other jobs lie between";
}

TEST_F(OwnershipTest, AListOfWorkersDoesNotTellWhatTheyDoForOthers) {
  PumpedWorker worker(coordinator_.get(), 1);
  const std::string of_bob = Submitted(kOwnerBob);
  Await([&] { return worker.leases() > 0; });
  const auto jobs = [&](const std::string& caller) {
    v1::ListWorkersResponse response;
    EXPECT_TRUE(Call(caller, &Stub::ListWorkers, v1::ListWorkersRequest(), &response).ok());
    std::set<std::string> shown;
    for (const v1::WorkerStatus& status : response.workers())
      shown.insert(status.job_ids().begin(), status.job_ids().end());
    return shown;
  };
  EXPECT_THAT(jobs(kAdmin), UnorderedElementsAre(of_bob));
  EXPECT_THAT(jobs("person/bob/read"), UnorderedElementsAre(of_bob));
  EXPECT_THAT(jobs(kOwnerAnn), IsEmpty());
  v1::GetLogRequest log;
  log.set_worker("w-1");
  v1::GetLogResponse events;
  EXPECT_EQ(Call(kOwnerAnn, &Stub::GetLog, log, &events).error_code(), grpc::StatusCode::PERMISSION_DENIED);
}

TEST_F(OwnershipTest, AWorkersIdIsOfNoUseToAnother) {
  const std::string job = Submitted(kOwnerAnn);
  const auto context = As("worker/node-7");
  const auto stream = workers().Work(context.get());
  v1::WorkerMessage message;
  message.mutable_hello()->set_name("node-7");
  message.mutable_hello()->set_numeric_class("test");
  message.mutable_hello()->set_slots(1);
  message.mutable_hello()->set_wire_version(rpc::kWireVersion);
  stream->Write(message);
  v1::CoordinatorMessage answer;
  ASSERT_TRUE(stream->Read(&answer));
  v1::FetchSpecRequest request;
  request.set_job_id(job);
  request.set_worker_id(answer.welcome().worker_id());
  ASSERT_TRUE(stream->Read(&answer));
  ASSERT_TRUE(answer.has_grant());
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  EXPECT_TRUE(workers().FetchSpec(As("worker/node-7").get(), request, &spec).ok());
  const grpc::Status refused = workers().FetchSpec(As("worker/node-8").get(), request, &spec);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::PERMISSION_DENIED);
  context->TryCancel();
  stream->Finish();
}

TEST_F(OwnershipTest, ARevokedCallerLosesItsOpenStreams) {
  const std::string job = Submitted(kOwnerAnn);
  const auto context = As(kOwnerAnn);
  v1::WatchJobRequest request;
  request.set_job_id(job);
  const auto reader = farm().WatchJob(context.get(), request);
  v1::JobStatus status;
  ASSERT_TRUE(reader->Read(&status));
  EXPECT_EQ(open_calls_.EndUnless([](const access::Identity& caller) {
    return caller.name == "ann" ? absl::UnauthenticatedError("revoked") : absl::OkStatus();
  }),
            1u);
  while (reader->Read(&status)) {
  }
  EXPECT_FALSE(reader->Finish().ok());
}

TEST_F(OwnershipTest, ChangesAndRefusalsAreInTheAuditLog) {
  const std::string job = Submitted(kOwnerAnn);
  OfJob(kOwnerAnn, job, &Stub::GetJob);
  OfJob(kOwnerAnn, job, &Stub::PauseJob);
  OfJob(kOwnerBob, job, &Stub::CancelJob);
  OfJob(kReader, job, &Stub::CancelJob);
  OfJob("", job, &Stub::GetJob);
  CallByPath(kOwnerAnn, "/lumifold.v1.WorkerService/Work");
  const std::string audit = AuditText();
  EXPECT_THAT(audit, HasSubstr(absl::StrCat("identity=\"ann\" role=submit id=id-of-ann address=",
                                            "unknown rpc=lumifold.v1.FarmService/SubmitJob subject=\"", job,
                                            "\" outcome=OK")))
      << audit;
  EXPECT_THAT(audit, HasSubstr(absl::StrCat("FarmService/PauseJob subject=\"", job, "\" outcome=OK")));
  EXPECT_THAT(audit,
              HasSubstr(absl::StrCat("FarmService/CancelJob subject=\"", job, "\" outcome=NOT_FOUND")));
  EXPECT_THAT(audit, HasSubstr("role=read id=id-of-ann"));
  EXPECT_THAT(audit, HasSubstr("FarmService/CancelJob subject=\"" + job + "\" outcome=PERMISSION_DENIED"));
  EXPECT_THAT(audit, HasSubstr("identity=\"\" role=nobody"));
  EXPECT_THAT(audit, HasSubstr("WorkerService/Work outcome=PERMISSION_DENIED"));
  EXPECT_THAT(audit, Not(HasSubstr("FarmService/GetJob subject=\"" + job + "\" outcome=OK")))
      << "it reads only";
}

}  // namespace
}  // namespace lumifold::server
