#include "server/page/farm_view.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <atomic>

#include "lumifold/v1/farm.grpc.pb.h"
#include "server/page/farm_calls.h"

namespace lumifold::page {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

/// A farm of jobs that the test makes.
class FarmOfTest final : public v1::FarmService::Service {
 public:
  grpc::Status ListJobs(grpc::ServerContext* context, const v1::ListJobsRequest*,
                        v1::ListJobsResponse* response) override {
    ++lists;
    callers.push_back(
        context->client_metadata().count("lumifold-in-name-of") == 0
            ? ""
            : std::string(context->client_metadata().find("lumifold-in-name-of")->second.data(),
                          context->client_metadata().find("lumifold-in-name-of")->second.size()));
    *response = jobs;
    return status;
  }
  grpc::Status GetJob(grpc::ServerContext*, const v1::GetJobRequest* request,
                      v1::JobStatus* response) override {
    response->set_job_id(request->job_id());
    return grpc::Status::OK;
  }
  grpc::Status CancelJob(grpc::ServerContext*, const v1::CancelJobRequest* request,
                         v1::JobStatus* response) override {
    response->set_job_id(request->job_id());
    response->set_state(v1::JOB_STATE_CANCELLED);
    return grpc::Status::OK;
  }
  grpc::Status ListWorkers(grpc::ServerContext*, const v1::ListWorkersRequest* request,
                           v1::ListWorkersResponse* response) override {
    response->add_workers()->set_name(request->page_token().empty() ? "a" : "b");
    if (request->page_token().empty()) response->set_next_page_token("next");
    return grpc::Status::OK;
  }
  grpc::Status GetServerStatus(grpc::ServerContext*, const v1::GetServerStatusRequest*,
                               v1::ServerStatus* response) override {
    response->set_free_bytes((uint64_t{5} << 26) + (lists % 1000));
    return grpc::Status::OK;
  }

  v1::ListJobsResponse jobs;
  grpc::Status status;
  std::atomic<uint64_t> lists = 0;
  std::vector<std::string> callers;
};

class FarmViewTest : public ::testing::Test {
 protected:
  FarmViewTest() {
    grpc::ServerBuilder builder;
    builder.RegisterService(&farm_);
    server_ = builder.BuildAndStart();
    calls_ = std::make_unique<FarmCalls>(server_->InProcessChannel({}));
    SetJobs({"j-2", "j-1"});
  }
  void SetJobs(const std::vector<std::string>& ids) {
    farm_.jobs.clear_jobs();
    for (const std::string& id : ids) farm_.jobs.add_jobs()->set_job_id(id);
  }

  FarmOfTest farm_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<FarmCalls> calls_;
  v1::PageSession session_;
};

TEST_F(FarmViewTest, AViewerGetsAllAtFirstAndThenWhatHasChanged) {
  FarmView view(calls_.get(), {.interval = absl::ZeroDuration(), .duty = 1e9});
  const auto first = view.Look(session_);
  const std::string all = EventsSince(0, *first);
  EXPECT_THAT(all, HasSubstr("event: server\ndata: {"));
  EXPECT_THAT(all, HasSubstr("event: jobs\ndata: {\"ids\":[\"j-2\",\"j-1\"],\"more\":false}\n\n"));
  EXPECT_THAT(all, HasSubstr("\"job_id\":\"j-2\""));
  EXPECT_THAT(all, HasSubstr("\"name\":\"b\"")) << "of the second page";

  EXPECT_THAT(EventsSince(first->number, *view.Look(session_)), IsEmpty()) << "free bytes are rounded";
  farm_.jobs.mutable_jobs(1)->set_units_done(3);
  const auto third = view.Look(session_);
  const std::string one = EventsSince(first->number, *third);
  EXPECT_THAT(one, HasSubstr("\"job_id\":\"j-1\""));
  EXPECT_THAT(one, Not(HasSubstr("event: jobs")));
  EXPECT_THAT(one, Not(HasSubstr("\"job_id\":\"j-2\"")));
  SetJobs({"j-3"});
  const std::string gone = EventsSince(third->number, *view.Look(session_));
  EXPECT_THAT(gone, HasSubstr("{\"ids\":[\"j-3\"]"));
  EXPECT_THAT(gone, HasSubstr("\"job_id\":\"j-3\""));
}

TEST_F(FarmViewTest, ViewersOfOneSessionShareALook) {
  FarmView view(calls_.get(), {.interval = absl::Hours(1)});
  for (int i = 0; i < 50; ++i) view.Look(session_);
  EXPECT_EQ(farm_.lists, 1u);
  v1::PageSession other;
  other.set_credential("t-1");
  view.Look(other);
  EXPECT_EQ(farm_.lists, 2u);
  EXPECT_THAT(farm_.callers, testing::ElementsAre("", "t-1")) << "in the name of the session's owner";
}

TEST_F(FarmViewTest, LooksTakeASmallShareOfTime) {
  FarmView view(calls_.get(), {.interval = absl::ZeroDuration(), .duty = 1e-9});
  view.Look(session_);
  view.Look(session_);
  EXPECT_EQ(farm_.lists, 1u) << "the next one is due after a thousand million times what it took";
}

TEST_F(FarmViewTest, ALinkForOneJobSeesThisJobOnly) {
  session_.set_job_id("j-9");
  FarmView view(calls_.get(), {});
  const std::string events = EventsSince(0, *view.Look(session_));
  EXPECT_THAT(events, HasSubstr("{\"ids\":[\"j-9\"],\"more\":false}"));
  EXPECT_THAT(events, Not(HasSubstr("event: workers")));
  EXPECT_THAT(events, Not(HasSubstr("event: server")));
  EXPECT_EQ(farm_.lists, 0u);
}

TEST_F(FarmViewTest, WhatFailsLeavesWhatWasThere) {
  FarmView view(calls_.get(), {.interval = absl::ZeroDuration(), .duty = 1e9});
  const auto first = view.Look(session_);
  farm_.status = {grpc::StatusCode::UNAUTHENTICATED, "revoked"};
  const auto second = view.Look(session_);
  EXPECT_TRUE(absl::IsUnauthenticated(second->status));
  EXPECT_EQ(second->order.size(), 2u);
  EXPECT_THAT(EventsSince(first->number, *second), IsEmpty());
}

TEST_F(FarmViewTest, CallsInJson) {
  const absl::StatusOr<std::string> answer = calls_->CallInJson(session_, "CancelJob", R"({"job_id":"j-1"})");
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_THAT(*answer, HasSubstr(R"("state":"JOB_STATE_CANCELLED")"));
  EXPECT_THAT(*answer, HasSubstr(R"("units_done":"0")")) << "fields of value 0 too";
  for (const char* request :
       {"", "{", "[]", "\"j-1\"", R"({"job":"j-1"})", R"({"job_id":7.5})", "{}}", "\xff"})
    EXPECT_TRUE(absl::IsInvalidArgument(calls_->CallInJson(session_, "CancelJob", request).status()))
        << request;
  for (const char* method : {"", "Cancel", "UploadAsset", "WatchJob", "DownloadResult", "GetPreview"})
    EXPECT_TRUE(absl::IsNotFound(calls_->CallInJson(session_, method, "{}").status())) << method;
}

TEST_F(FarmViewTest, ALinkForOneJobChangesNothing) {
  session_.set_job_id("j-1");
  EXPECT_TRUE(calls_->CallInJson(session_, "GetJob", R"({"job_id":"j-1"})").ok());
  EXPECT_TRUE(
      absl::IsPermissionDenied(calls_->CallInJson(session_, "GetJob", R"({"job_id":"j-2"})").status()));
  for (const char* method :
       {"AddSamples", "CancelJob", "PauseJob", "ResumeJob", "RetryJob", "SetJobPriority", "ListJobs"}) {
    const absl::Status status =
        calls_->CallInJson(session_, method, method == std::string("ListJobs") ? "{}" : R"({"job_id":"j-1"})")
            .status();
    EXPECT_TRUE(absl::IsPermissionDenied(status)) << method << " " << status;
  }
  EXPECT_TRUE(
      absl::IsPermissionDenied(calls_->CallInJson(session_, "GetLog", R"({"worker":"w-1"})").status()));
}

}  // namespace
}  // namespace lumifold::page
