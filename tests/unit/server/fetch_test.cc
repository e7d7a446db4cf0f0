// What workers may read: specs and files of the jobs of their leases.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"
#include "proto/rpc/sha256.h"
#include "tests/unit/server/farm_fixture.h"
#include "tests/unit/server/holding_worker.h"

namespace lumifold::server {
namespace {

using testing::HasSubstr;

class FetchTest : public FarmFixture {
 protected:
  grpc::Status FetchSpec(const std::string& worker_id, const std::string& job_id) {
    v1::FetchSpecRequest request;
    request.set_worker_id(worker_id);
    request.set_job_id(job_id);
    grpc::ClientContext context;
    v1::JobSpec spec;
    spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
    return v1::WorkerService::NewStub(Channel())->FetchSpec(&context, request, &spec);
  }

  grpc::Status FetchAsset(const std::string& worker_id, const std::string& job_id, const std::string& sha256,
                          std::string* bytes = nullptr) {
    v1::FetchAssetRequest request;
    request.set_worker_id(worker_id);
    request.set_job_id(job_id);
    request.set_sha256(sha256);
    grpc::ClientContext context;
    const auto reader = v1::WorkerService::NewStub(Channel())->FetchAsset(&context, request);
    v1::ByteChunk chunk;
    while (reader->Read(&chunk)) {
      if (bytes != nullptr) *bytes += chunk.data();
    }
    return reader->Finish();
  }

  /// Units and result of a frame, as a worker that finishes it asks for them and delivers them.
  grpc::Status FetchUnits(const std::string& worker_id, const std::string& job_id) {
    v1::FetchUnitsRequest request;
    request.set_worker_id(worker_id);
    request.mutable_unit()->set_job_id(job_id);
    request.mutable_unit()->set_kind(v1::UNIT_KIND_RESULT);
    request.set_attempt(1);
    grpc::ClientContext context;
    const auto reader = v1::WorkerService::NewStub(Channel())->FetchUnits(&context, request);
    v1::ByteChunk chunk;
    EXPECT_FALSE(reader->Read(&chunk));
    return reader->Finish();
  }
  grpc::Status DeliverResult(const v1::DeliverResultRequest& request) {
    grpc::ClientContext context;
    v1::DeliverResultResponse response;
    const auto writer = v1::WorkerService::NewStub(Channel())->DeliverResult(&context, &response);
    writer->Write(request);
    writer->WritesDone();
    return writer->Finish();
  }

  /// Stores content that no job has; its SHA-256.
  std::string StoreOther() {
    const std::string content = "a scene of somebody else";
    v1::AssetRef asset;
    asset.set_sha256(rpc::Sha256Hex(content));
    asset.set_size(content.size());
    EXPECT_TRUE(Upload(asset, content, content.size()).ok());
    return asset.sha256();
  }
};

TEST_F(FetchTest, UnitsAndResultsOfAFrameAreForTheWorkerThatHasTheLeaseToFinishIt) {
  const std::string job = *Submit(Spec());
  HoldingWorker worker(Channel());
  ASSERT_EQ(worker.AwaitGrant(), job);  // of units, with the same attempt
  for (const std::string& id : {worker.id(), std::string("w-99"), std::string("nobody")}) {
    EXPECT_EQ(FetchUnits(id, job).error_code(), grpc::StatusCode::PERMISSION_DENIED) << id;
    EXPECT_EQ(FetchUnits(id, "j-none").error_code(), grpc::StatusCode::NOT_FOUND) << id;
    v1::DeliverResultRequest request;
    request.mutable_announce()->set_worker_id(id);
    request.mutable_announce()->mutable_unit()->set_job_id(job);
    request.mutable_announce()->mutable_unit()->set_kind(v1::UNIT_KIND_RESULT);
    request.mutable_announce()->set_attempt(1);
    EXPECT_EQ(DeliverResult(request).error_code(), grpc::StatusCode::PERMISSION_DENIED) << id;
  }
  v1::DeliverResultRequest chunk;
  chunk.mutable_chunk()->set_total_size(1);
  EXPECT_EQ(DeliverResult(chunk).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(FetchTest, AWorkerReadsTheJobsOfItsLeases) {
  const v1::JobSpec spec = Spec();
  const std::string job = *Submit(spec);
  HoldingWorker worker(Channel());
  ASSERT_EQ(worker.AwaitGrant(), job);
  EXPECT_TRUE(FetchSpec(worker.id(), job).ok());
  std::string bytes;
  EXPECT_TRUE(FetchAsset(worker.id(), job, spec.scene().file().sha256(), &bytes).ok());
  EXPECT_EQ(bytes, "a scene nobody reads");
}

TEST_F(FetchTest, NotWithoutALeaseOfTheJob) {
  v1::JobSpec spec = Spec();
  const std::string first = *Submit(spec);
  HoldingWorker worker(Channel());
  ASSERT_EQ(worker.AwaitGrant(), first);
  const std::string scene = spec.scene().file().sha256();
  spec.set_seed(2);
  const std::string second = *Submit(spec, "request-2");  // the worker's one slot is taken
  const grpc::Status refused = FetchSpec(worker.id(), second);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_EQ(refused.error_message(), absl::StrCat("worker ", worker.id(), " has no lease of job ", second));
  EXPECT_EQ(FetchAsset(worker.id(), second, scene).error_code(), grpc::StatusCode::PERMISSION_DENIED);
}

TEST_F(FetchTest, NotWithoutAConnection) {
  const v1::JobSpec spec = Spec();
  const std::string job = *Submit(spec);
  const std::string scene = spec.scene().file().sha256();
  std::string gone;
  {
    HoldingWorker worker(Channel());
    ASSERT_EQ(worker.AwaitGrant(), job);
    gone = worker.id();
  }
  while (FetchSpec(gone, job).ok()) {
  }
  for (const std::string& id : {gone, std::string(), std::string("w-99"), std::string("w-+1"),
                                std::string("w-01"), std::string("w- 1"), std::string("../w-1")}) {
    const grpc::Status refused = FetchAsset(id, job, scene);
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::PERMISSION_DENIED) << id;
    EXPECT_THAT(refused.error_message(), HasSubstr("is connected")) << id;
    EXPECT_EQ(FetchSpec(id, job).error_code(), grpc::StatusCode::PERMISSION_DENIED) << id;
  }
}

TEST_F(FetchTest, NotFilesThatTheJobDoesNotHave) {
  const std::string job = *Submit(Spec());
  HoldingWorker worker(Channel());
  ASSERT_EQ(worker.AwaitGrant(), job);
  // The answer is the same for what is stored and what is not, so that hashes cannot be tried.
  for (const std::string& sha256 :
       {StoreOther(), std::string(64, '0'), std::string("../ledger.db"), std::string("a\0b", 3)}) {
    const grpc::Status refused = FetchAsset(worker.id(), job, sha256);
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::PERMISSION_DENIED);
    EXPECT_THAT(refused.error_message(), HasSubstr(absl::StrCat("job ", job, " has no file \"")));
  }
}

TEST_F(FetchTest, NothingOfAJobThatHasEnded) {
  const v1::JobSpec spec = Spec();
  const std::string job = *Submit(spec);
  HoldingWorker worker(Channel());
  ASSERT_EQ(worker.AwaitGrant(), job);
  grpc::ClientContext context;
  v1::CancelJobRequest request;
  request.set_job_id(job);
  v1::JobStatus status;
  ASSERT_TRUE(v1::FarmService::NewStub(Channel())->CancelJob(&context, request, &status).ok());
  EXPECT_EQ(FetchSpec(worker.id(), job).error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(FetchAsset(worker.id(), job, spec.scene().file().sha256()).error_code(),
            grpc::StatusCode::NOT_FOUND);
}

}  // namespace
}  // namespace lumifold::server
