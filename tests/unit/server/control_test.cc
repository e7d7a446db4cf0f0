#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/status_codec.h"
#include "tests/unit/server/farm_fixture.h"
#include "tests/unit/server/holding_worker.h"

namespace lumifold::server {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

/// The calls of an operator.
class ControlTest : public FarmFixture {
 protected:
  using Stub = v1::FarmService::Stub;

  template <typename Response, typename Request>
  absl::StatusOr<Response> Call(grpc::Status (Stub::*call)(grpc::ClientContext*, const Request&, Response*),
                                const Request& request) {
    const auto stub = v1::FarmService::NewStub(Channel());
    grpc::ClientContext context;
    Response response;
    const absl::Status status = rpc::StatusFromGrpc((stub.get()->*call)(&context, request, &response));
    if (!status.ok()) return status;
    return response;
  }

  template <typename Request>
  static Request OfJob(const std::string& job) {
    Request request;
    request.set_job_id(job);
    return request;
  }
  absl::StatusOr<v1::JobStatus> Pause(const std::string& job) {
    return Call<v1::JobStatus>(&Stub::PauseJob, OfJob<v1::PauseJobRequest>(job));
  }
  absl::StatusOr<v1::JobStatus> Resume(const std::string& job) {
    return Call<v1::JobStatus>(&Stub::ResumeJob, OfJob<v1::ResumeJobRequest>(job));
  }
  absl::StatusOr<v1::JobStatus> SetPriority(const std::string& job, int priority) {
    auto request = OfJob<v1::SetJobPriorityRequest>(job);
    request.set_priority(priority);
    return Call<v1::JobStatus>(&Stub::SetJobPriority, request);
  }
  /// The codes of the reasons, then their texts.
  std::vector<std::string> Explain(const std::string& job) {
    std::vector<std::string> reasons;
    const auto response = Call<v1::ExplainJobResponse>(&Stub::ExplainJob, OfJob<v1::ExplainJobRequest>(job));
    EXPECT_TRUE(response.ok()) << response.status();
    if (!response.ok()) return reasons;
    for (const v1::Reason& reason : response->reasons())
      reasons.push_back(absl::StrCat(reason.code(), ": ", reason.text()));
    return reasons;
  }
  std::vector<v1::WorkerStatus> Workers() {
    v1::ListWorkersRequest request;
    request.set_limit(2);  // several pages
    std::vector<v1::WorkerStatus> workers;
    do {
      const auto page = Call<v1::ListWorkersResponse>(&Stub::ListWorkers, request);
      EXPECT_TRUE(page.ok()) << page.status();
      if (!page.ok()) break;
      workers.insert(workers.end(), page->workers().begin(), page->workers().end());
      request.set_page_token(page->next_page_token());
    } while (!request.page_token().empty());
    return workers;
  }
  /// "id name state reason" of each worker.
  std::vector<std::string> WorkerLines() {
    std::vector<std::string> lines;
    for (const v1::WorkerStatus& worker : Workers()) {
      lines.push_back(absl::StrCat(worker.worker_id(), " ", worker.name(), " ",
                                   v1::WorkerState_Name(worker.state()), " ", worker.reason()));
    }
    return lines;
  }
  absl::StatusOr<v1::WorkerStatus> OnWorker(grpc::Status (Stub::*call)(grpc::ClientContext*,
                                                                       const v1::WorkerRequest&,
                                                                       v1::WorkerStatus*),
                                            const std::string& worker, const std::string& reason = "") {
    v1::WorkerRequest request;
    request.set_worker(worker);
    request.set_reason(reason);
    return Call<v1::WorkerStatus>(call, request);
  }
  std::vector<std::string> Log(const v1::GetLogRequest& request) {
    std::vector<std::string> texts;
    const auto log = Call<v1::GetLogResponse>(&Stub::GetLog, request);
    EXPECT_TRUE(log.ok()) << log.status();
    if (!log.ok()) return texts;
    for (const v1::LogEvent& event : log->events()) texts.push_back(event.text());
    return texts;
  }

  /// A worker with a name that never delivers what it is granted.
  std::unique_ptr<FakeWorker> Holder(const std::string& name) const {
    return Worker({.slots = 1, .spoil = [name](v1::WorkerMessage& message) {
                     if (message.has_hello()) message.mutable_hello()->set_name(name);
                     if (message.has_chunk()) message.mutable_chunk()->set_attempt(0);
                   }});
  }
  void AwaitWorkers(const std::string& job, int count) {
    WaitUntil(job, [count](const v1::JobStatus& status) { return status.workers() == count; });
  }
};

TEST_F(ControlTest, APausedJobWaitsUntilItIsResumedAlsoAfterARestart) {
  const std::string job = *Submit(Spec());
  EXPECT_EQ(Pause(job)->state(), v1::JOB_STATE_PAUSED);
  EXPECT_TRUE(Pause(job)->scheduling().paused());
  StopServer();
  StartServer();
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_PAUSED);
  const auto worker = Worker();
  const std::string other = *Submit(Spec(), "other");
  EXPECT_EQ(WaitForEnd(other).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(Get(job)->units_done(), 0);
  EXPECT_THAT(Explain(job), Contains("paused: the job is paused"));
  EXPECT_TRUE(Resume(job).ok());
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(Pause(job).status(), absl::FailedPreconditionError("job " + job + " has ended"));
  EXPECT_TRUE(absl::IsNotFound(Resume("j-none").status()));
}

TEST_F(ControlTest, TheSchedulingOfAJobIsCheckedAndKept) {
  v1::SubmitJobRequest request;
  *request.mutable_spec() = Spec();
  request.set_request_id("with scheduling");
  request.mutable_scheduling()->set_paused(true);
  request.mutable_scheduling()->set_priority(20);
  request.mutable_scheduling()->add_tags("gpu");
  const std::string job = Call<v1::SubmitJobResponse>(&Stub::SubmitJob, request)->job_id();
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_PAUSED);
  EXPECT_EQ(SetPriority(job, -7)->scheduling().priority(), -7);
  EXPECT_EQ(SetPriority(job, 101).status(), absl::InvalidArgumentError("priority is 101, not -100 to 100"));
  StopServer();
  StartServer();
  const v1::Scheduling scheduling = Get(job)->scheduling();
  EXPECT_EQ(scheduling.priority(), -7);
  EXPECT_EQ(scheduling.user(), "anonymous");
  EXPECT_TRUE(Resume(job).ok());
  const auto without = Worker();
  EXPECT_EQ(WaitForEnd(*Submit(Spec(), "other")).state(), v1::JOB_STATE_DONE);
  EXPECT_THAT(Explain(job), Contains(AllOf(HasSubstr("no_worker: "), HasSubstr("gpu"))));
  const auto with = Worker({.spoil = [](v1::WorkerMessage& message) {
    if (message.has_hello()) message.mutable_hello()->add_tags("gpu");
  }});
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_THAT(Explain(job), IsEmpty());
  request.set_request_id("wrong");
  request.mutable_scheduling()->set_audit_share(2);
  EXPECT_EQ(Call<v1::SubmitJobResponse>(&Stub::SubmitJob, request).status(),
            absl::InvalidArgumentError("audit_share is 2, not 0 to 1"));
}

TEST_F(ControlTest, AJobMovedToTheFrontStaysThereAfterARestart) {
  const std::string first = *Submit(Spec(), "first");
  const std::string second = *Submit(Spec(), "second");
  EXPECT_THAT(Explain(second),
              Contains(HasSubstr("turn: 1 job of its user with the same priority comes first, "
                                 "the next is " +
                                 first)));
  auto to_front = OfJob<v1::SetJobPriorityRequest>(second);
  to_front.set_to_front(true);
  EXPECT_TRUE(Call<v1::JobStatus>(&Stub::SetJobPriority, to_front).ok());
  EXPECT_THAT(Explain(first), Contains(HasSubstr("the next is " + second)));
  StopServer();
  StartServer();
  EXPECT_THAT(Explain(first), Contains(HasSubstr("the next is " + second)));
  EXPECT_THAT(Explain(second), Not(Contains(HasSubstr("turn"))));
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(first).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(WaitForEnd(second).state(), v1::JOB_STATE_DONE);
}

TEST_F(ControlTest, SaysWhichJobsAJobWaitsFor) {
  const std::string first = *Submit(Spec(), "first");
  v1::SubmitJobRequest request;
  *request.mutable_spec() = Spec();
  request.set_request_id("second");
  request.mutable_scheduling()->add_after(first);
  const auto second = Call<v1::SubmitJobResponse>(&Stub::SubmitJob, request);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_THAT(Explain(second->job_id()), Contains("after: the job waits until these are done: " + first));
}

TEST_F(ControlTest, SaysWhyAJobHasEnded) {
  const std::string job = *Submit(Spec());
  ASSERT_TRUE(Call<v1::JobStatus>(&Stub::CancelJob, OfJob<v1::CancelJobRequest>(job)).ok());
  EXPECT_THAT(Explain(job), ElementsAre("cancelled: the job was cancelled"));
  const auto missing =
      Call<v1::ExplainJobResponse>(&Stub::ExplainJob, OfJob<v1::ExplainJobRequest>("j-none"));
  EXPECT_TRUE(absl::IsNotFound(missing.status()));
}

TEST_F(ControlTest, ABlockedWorkerLosesItsLeasesAndGetsNoneAlsoAfterARestart) {
  const std::string job = *Submit(Spec());
  auto ann = Holder("ann");
  AwaitWorkers(job, 1);
  EXPECT_THAT(WorkerLines(), ElementsAre("w-1 ann WORKER_STATE_BUSY "));
  EXPECT_EQ(Workers()[0].job_ids(0), job);
  EXPECT_EQ(OnWorker(&Stub::BlockWorker, "w-1", "wrong pixels\n" + std::string(9999, 'x'))->state(),
            v1::WORKER_STATE_BLOCKED);
  EXPECT_LE(Workers()[0].reason().size(), rpc::kMaxReasonBytes);
  EXPECT_EQ(OnWorker(&Stub::BlockWorker, "ann", "wrong pixels")->reason(), "wrong pixels");
  AwaitWorkers(job, 0);
  ann = nullptr;
  StopServer();
  StartServer();
  EXPECT_THAT(WorkerLines(), ElementsAre(" ann WORKER_STATE_GONE wrong pixels"));
  ann = Holder("ann");
  const auto ben = Holder("ben");
  AwaitWorkers(job, 1);
  EXPECT_THAT(WorkerLines(), Contains(HasSubstr("ben WORKER_STATE_BUSY")));
  const auto is_ann = HasSubstr("ann WORKER_STATE_BLOCKED wrong pixels");
  WaitFor([&] { return testing::Matches(Contains(is_ann))(WorkerLines()); });  // she may connect after him
  EXPECT_EQ(OnWorker(&Stub::ReadmitWorker, "ann")->name(), "ann");
  AwaitWorkers(job, 2);
  EXPECT_TRUE(absl::IsNotFound(OnWorker(&Stub::ReadmitWorker, "eve").status()));
  EXPECT_TRUE(absl::IsNotFound(OnWorker(&Stub::BlockWorker, "w-99").status()));
  EXPECT_EQ(OnWorker(&Stub::BlockWorker, "").status(),
            absl::InvalidArgumentError("worker has 0 bytes, not 1 to 256"));
}

TEST_F(ControlTest, ListsConnectedAndBlockedWorkersInPages) {
  const auto ann = Holder("ann");
  const std::string job = *Submit(Spec());
  AwaitWorkers(job, 1);
  const auto ben = Holder("ben");
  AwaitWorkers(job, 2);
  for (const char* name : {"eve", "dan", "fay"}) ASSERT_TRUE(OnWorker(&Stub::BlockWorker, name, "").ok());
  EXPECT_THAT(WorkerLines(),
              ElementsAre("w-1 ann WORKER_STATE_BUSY ", "w-2 ben WORKER_STATE_BUSY ",
                          " dan WORKER_STATE_GONE ", " eve WORKER_STATE_GONE ", " fay WORKER_STATE_GONE "));
  v1::ListWorkersRequest request;
  request.set_page_token("nonsense");
  EXPECT_TRUE(absl::IsInvalidArgument(Call<v1::ListWorkersResponse>(&Stub::ListWorkers, request).status()));
}

TEST_F(ControlTest, AWorkerIsListedWithItsLastFramesAlsoWhenItIsGone) {
  const std::string job = *Submit(Spec());
  v1::ListWorkersRequest request;
  {
    const auto worker = Worker();
    EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
    request.set_worker(Call<v1::ListWorkersResponse>(&Stub::ListWorkers, request)->workers(0).name());
  }
  const v1::ListWorkersResponse listed = *Call<v1::ListWorkersResponse>(&Stub::ListWorkers, request);
  ASSERT_EQ(listed.workers_size(), 1);
  ASSERT_EQ(listed.workers(0).history_size(), 1);
  EXPECT_EQ(listed.workers(0).history(0).job_id(), job);
  EXPECT_EQ(listed.workers(0).history(0).units(), kUnits);
  EXPECT_GE(listed.workers(0).history(0).last_unix_ms(), listed.workers(0).history(0).first_unix_ms());
  request.set_worker("nobody");
  EXPECT_EQ(Call<v1::ListWorkersResponse>(&Stub::ListWorkers, request)->workers_size(), 0);
}

TEST_F(ControlTest, AWorkerIsListedWithAllItSaysAndHasDone) {
  const absl::Time before = absl::Now();
  const std::string first = *Submit(Spec());
  const auto worker = Worker({.slots = 2, .spoil = [](v1::WorkerMessage& message) {
                                if (message.has_hello()) {
                                  message.mutable_hello()->set_name("ann:7");
                                  message.mutable_hello()->set_memory_bytes(uint64_t{9} << 30);
                                  message.mutable_hello()->add_tags("gpu");
                                  message.mutable_hello()->add_tags("night");
                                }
                              }});
  EXPECT_EQ(WaitForEnd(first).state(), v1::JOB_STATE_DONE);
  const v1::WorkerStatus status = Workers().at(0);
  EXPECT_EQ(status.worker_id(), "w-1");
  EXPECT_EQ(status.numeric_class(), "test");
  EXPECT_EQ(status.memory_bytes(), uint64_t{9} << 30);
  EXPECT_THAT(std::vector<std::string>(status.tags().begin(), status.tags().end()),
              ElementsAre("gpu", "night"));
  EXPECT_EQ(status.slots(), 2);
  EXPECT_EQ(status.leases(), 0);
  EXPECT_EQ(status.units_done(), kUnits);
  EXPECT_EQ(status.units_failed(), 0);
  EXPECT_GT(status.seconds_per_unit(), 0);
  EXPECT_THAT(std::vector<std::string>(status.job_ids().begin(), status.job_ids().end()), IsEmpty());
  EXPECT_GE(absl::FromUnixMillis(status.connected_unix_ms()), before - absl::Milliseconds(1));
  EXPECT_LE(absl::FromUnixMillis(status.connected_unix_ms()), absl::Now());
}

TEST_F(ControlTest, ADrainedWorkerIsToldAndGetsNoMoreLeases) {
  const std::string job = *Submit(Spec());
  const auto ann = Holder("ann");
  AwaitWorkers(job, 1);
  EXPECT_EQ(OnWorker(&Stub::DrainWorker, "ann")->state(), v1::WORKER_STATE_DRAINING);
  EXPECT_TRUE(ann->WaitForDrain());
  EXPECT_TRUE(absl::IsNotFound(OnWorker(&Stub::DrainWorker, "ben").status()));
  const auto ben = Holder("ben");
  AwaitWorkers(job, 2);
}

TEST_F(ControlTest, ANameOfSeveralWordsIsOneFieldOfTheLog) {
  const std::string job = *Submit(Spec());
  const auto worker = Holder("ann job=j-2");
  AwaitWorkers(job, 1);
  EXPECT_EQ(OnWorker(&Stub::BlockWorker, "ann job=j-2")->name(), R"(ann\x20job=j-2)");
  v1::GetLogRequest request;
  request.set_worker("ann job=j-2");
  EXPECT_THAT(Log(request), Contains(HasSubstr("event=worker_blocked")));
  EXPECT_TRUE(
      absl::IsNotFound(Call<v1::GetLogResponse>(&Stub::GetLog, OfJob<v1::GetLogRequest>("j-2")).status()));
}

TEST_F(ControlTest, TheLastEventsOfJobsAndWorkersCanBeRead) {
  const std::string job = *Submit(Spec());
  const auto worker = Worker();
  WaitForEnd(job);
  const std::vector<std::string> log = Log(OfJob<v1::GetLogRequest>(job));
  EXPECT_THAT(log, Contains(HasSubstr("event=job_submitted job=" + job)));
  EXPECT_THAT(log.back(), HasSubstr("event=job_ended job=" + job));
  v1::GetLogRequest request;
  request.set_worker("fake");
  EXPECT_THAT(Log(request), Contains(HasSubstr("event=worker_connected worker=w-1/fake")));
  EXPECT_THAT(Log(request), Not(Contains(HasSubstr("job_submitted"))));
  request.set_worker("nobody");
  EXPECT_TRUE(absl::IsNotFound(Call<v1::GetLogResponse>(&Stub::GetLog, request).status()));
  request.set_job_id(job);
  EXPECT_TRUE(absl::IsInvalidArgument(Call<v1::GetLogResponse>(&Stub::GetLog, request).status()));
  EXPECT_TRUE(
      absl::IsNotFound(Call<v1::GetLogResponse>(&Stub::GetLog, OfJob<v1::GetLogRequest>("j-none")).status()));
}

TEST_F(ControlTest, TheStatusCountsLeasesAndFramesInFlight) {
  const auto status = [&] {
    return *Call<v1::ServerStatus>(&Stub::GetServerStatus, v1::GetServerStatusRequest());
  };
  const std::string job = *Submit(Spec());
  EXPECT_EQ(status().leases(), 0);
  EXPECT_EQ(status().frames_in_flight(), 0) << "nothing of the job has begun";
  EXPECT_EQ(status().active_jobs(), 1);
  {
    HoldingWorker holder(Channel());
    ASSERT_EQ(holder.AwaitGrant(), job);
    EXPECT_EQ(status().leases(), 1);
    EXPECT_EQ(status().frames_in_flight(), 1);
    EXPECT_EQ(status().workers(), 1);
    EXPECT_EQ(status().slots(), 1);
  }
  const auto worker = Worker();
  WaitForEnd(job);
  EXPECT_EQ(status().leases(), 0);
  EXPECT_EQ(status().frames_in_flight(), 0);
  EXPECT_EQ(status().active_jobs(), 0);
}

}  // namespace
}  // namespace lumifold::server
