#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/trace_context.h"
#include "tests/unit/server/farm_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::Contains;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

constexpr char kTrace[] = "4bf92f3577b34da6a3ce929d0e0e4736";
constexpr char kParent[] = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

class TraceTest : public FarmFixture {
 protected:
  using Stub = v1::FarmService::Stub;

  /// Submits a job under this traceparent, or without one; returns its id.
  std::string SubmitUnder(const std::string& trace_parent, const std::string& request_id = "request-1",
                          const std::string& trace_id_of_request = "") {
    v1::SubmitJobRequest request;
    *request.mutable_spec() = Spec();
    request.set_request_id(request_id);
    request.mutable_scheduling()->set_trace_id(trace_id_of_request);
    grpc::ClientContext context;
    if (!trace_parent.empty()) context.AddMetadata(rpc::kTraceParentKey, trace_parent);
    v1::SubmitJobResponse response;
    const grpc::Status status = v1::FarmService::NewStub(Channel())->SubmitJob(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.job_id();
  }
  std::string TraceOf(const std::string& job) { return Get(job)->scheduling().trace_id(); }

  std::vector<v1::LogEvent> Log(const std::string& job, const std::string& worker = "") {
    v1::GetLogRequest request;
    request.set_job_id(job);
    request.set_worker(worker);
    request.set_limit(1000);
    grpc::ClientContext context;
    v1::GetLogResponse response;
    const grpc::Status status = v1::FarmService::NewStub(Channel())->GetLog(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return {response.events().begin(), response.events().end()};
  }
  static std::vector<std::string> Texts(const std::vector<v1::LogEvent>& events, bool of_workers) {
    std::vector<std::string> texts;
    for (const v1::LogEvent& event : events) {
      if (event.worker().empty() != of_workers) texts.push_back(event.text());
    }
    return texts;
  }

  /// A worker that fails its first unit and sends these lines with the failure; "JOB" in them is the unit's
  /// job.
  std::unique_ptr<FakeWorker> FailingWorker(std::vector<std::string> lines) const {
    return Worker({.spoil = [lines = std::move(lines), failed = false](v1::WorkerMessage& message) mutable {
      if (failed || !message.chunk().pixels().last()) return;
      failed = true;
      v1::UnitFailure failure;
      *failure.mutable_unit() = message.chunk().unit();
      failure.set_attempt(message.chunk().attempt());
      failure.set_error("made up");
      for (const std::string& line : lines) {
        v1::LogEvent* event = failure.add_log();
        event->set_level("error");
        event->set_unix_ms(1);
        event->set_text(absl::StrReplaceAll(line, {{"JOB", failure.unit().job_id()}}));
      }
      *message.mutable_failure() = failure;
    }});
  }
};

TEST_F(TraceTest, AJobKeepsTheTraceOfItsSubmissionAlsoAfterARestart) {
  const std::string job = SubmitUnder(kParent);
  EXPECT_EQ(TraceOf(job), kTrace);
  EXPECT_THAT(Texts(Log(job), false), Contains(HasSubstr(absl::StrCat("event=job_submitted job=", job))));
  EXPECT_THAT(Texts(Log(job), false), Each(HasSubstr(absl::StrCat(" trace=", kTrace))));
  StopServer();
  StartServer();
  EXPECT_EQ(TraceOf(job), kTrace);
  const auto worker = Worker();
  WaitForEnd(job);
  EXPECT_THAT(Texts(Log(job), false), Contains(HasSubstr("event=job_restored")));
  EXPECT_THAT(Texts(Log(job), false), Contains(HasSubstr("event=job_ended")));
  EXPECT_THAT(Texts(Log(job), false), Each(HasSubstr(absl::StrCat(" trace=", kTrace))));
  StopServer();
  StartServer();
  ASSERT_TRUE(Download(job, 0).ok());
  EXPECT_THAT(Texts(Log(job), false), Contains(HasSubstr("event=result_opened")));
  EXPECT_THAT(Texts(Log(job), false), Each(HasSubstr(absl::StrCat(" trace=", kTrace))));
}

TEST_F(TraceTest, ATraceParentThatIsMalformedIsReplaced) {
  const std::string none = TraceOf(SubmitUnder("", "r-1"));
  const std::string malformed = TraceOf(SubmitUnder(absl::StrCat("01-", kTrace), "r-2"));
  const std::string of_request = TraceOf(SubmitUnder("", "r-3", kTrace));
  EXPECT_TRUE(rpc::IsTraceId(none)) << none;
  EXPECT_TRUE(rpc::IsTraceId(malformed)) << malformed;
  EXPECT_TRUE(rpc::IsTraceId(of_request)) << of_request;
  EXPECT_NE(none, malformed);
  EXPECT_NE(of_request, kTrace) << "it is of the call, not of the request";
}

TEST_F(TraceTest, ARepeatedSubmissionMayComeUnderAnotherTrace) {
  const std::string job = SubmitUnder(kParent);
  EXPECT_EQ(SubmitUnder(""), job);
  EXPECT_EQ(TraceOf(job), kTrace);
}

TEST_F(TraceTest, TheLinesOfAFailingWorkerAreInTheLogOfTheJob) {
  const std::string job = SubmitUnder(kParent);
  const auto worker =
      FailingWorker({"event=unit_failed job=JOB tile=1 error=\"no memory\"", "event=sandbox up=\"all\""});
  WaitForEnd(job);
  const std::vector<v1::LogEvent> log = Log(job);
  EXPECT_THAT(Texts(log, true), testing::ElementsAre(HasSubstr("tile=1 error=\"no memory\"")));
  EXPECT_EQ(log.front().worker(), "w-1/fake") << "the oldest by its own clock";
  EXPECT_EQ(log.front().level(), "error");
  EXPECT_THAT(Texts(log, false), Contains(HasSubstr("event=unit_failed")));
  EXPECT_THAT(Texts(Log("", "w-1"), true), SizeIs(2));
  EXPECT_THAT(Texts(Log("", "fake"), false), Contains(HasSubstr("event=worker_connected")));
}

TEST_F(TraceTest, TheLinesOfAWorkerAreBoundedAndOfItsOwnJobsAlone) {
  const std::string job = SubmitUnder(kParent);
  std::vector<std::string> lines(200, "event=unit_failed job=JOB \n\x1b[2J" + std::string(10'000, 'x'));
  lines.push_back("event=spoof job=j-never-had");
  const auto worker = FailingWorker(lines);
  WaitForEnd(job);
  const std::vector<std::string> texts = Texts(Log(job), true);
  EXPECT_THAT(texts, SizeIs(testing::Le(rpc::kMaxTailLines)));
  EXPECT_THAT(texts, Not(IsEmpty()));
  for (const std::string& text : texts) {
    EXPECT_LE(text.size(), rpc::kMaxTailLineBytes);
    EXPECT_EQ(text.find_first_of("\n\x1b"), std::string::npos);
  }
  EXPECT_THAT(Texts(Log("", "w-1"), true), Contains(HasSubstr("event=spoof")));
  v1::GetLogRequest spoofed;
  spoofed.set_job_id("j-never-had");
  grpc::ClientContext context;
  v1::GetLogResponse response;
  EXPECT_EQ(v1::FarmService::NewStub(Channel())->GetLog(&context, spoofed, &response).error_code(),
            grpc::StatusCode::NOT_FOUND);
}

}  // namespace
}  // namespace lumifold::server
