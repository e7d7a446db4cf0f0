#include "tests/unit/server/farm_fixture.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/status_codec.h"
#include "server/job/job_state.h"

namespace lumifold::server {
namespace {

constexpr absl::Duration kDeadline = absl::Minutes(10);

std::unique_ptr<v1::FarmService::Stub> NewStub(const std::shared_ptr<grpc::Channel>& channel) {
  return v1::FarmService::NewStub(channel);
}

void SetDeadline(grpc::ClientContext* context) {
  context->set_deadline(absl::ToChronoTime(absl::Now() + kDeadline));
}

}  // namespace

ServerOptions FarmFixture::Options() const {
  ServerOptions options;
  options.data.folder = folder_.PathOf("data");
  options.listen = "127.0.0.1:0";
  return options;
}

void FarmFixture::RestartForOneWorker() {
  StopServer();
  ServerOptions options = Options();
  options.only_one_worker = true;
  StartServer(options);
}

void FarmFixture::StartServer() { StartServer(Options()); }

void FarmFixture::StartServer(const ServerOptions& options) {
  absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
  ASSERT_TRUE(server.ok()) << server.status();
  server_ = *std::move(server);
  ASSERT_EQ(server_->port() > 0, !options.listen.empty());
}

std::shared_ptr<grpc::Channel> FarmFixture::Channel() const {
  if (server_ == nullptr) return rpc::MakeChannel(absl::StrCat("127.0.0.1:", process_port_), {});
  if (server_->port() == 0) return server_->InProcessChannel();
  return rpc::MakeChannel(absl::StrCat("127.0.0.1:", server_->port()), {});
}

std::unique_ptr<FakeWorker> FarmFixture::Worker(FakeWorkerOptions options) const {
  return std::make_unique<FakeWorker>(Channel(), std::move(options));
}

v1::JobSpec FarmFixture::Spec() {
  const std::string content = "a scene nobody reads";
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  v1::AssetRef* file = spec.mutable_scene()->mutable_file();
  file->set_sha256(rpc::Sha256Hex(content));
  file->set_size(content.size());
  EXPECT_TRUE(Upload(*file, content, 7).ok());
  spec.mutable_scene()->set_display_name("made-up.glb");
  spec.set_width(20);
  spec.set_height(12);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(10);
  spec.set_pass_samples(4);
  spec.set_frame_count(1);
  spec.set_max_bounces(8);
  spec.mutable_filter()->set_method("none");
  return spec;
}

grpc::Status FarmFixture::Upload(const v1::AssetRef& asset, const std::string& content, size_t piece_bytes) {
  const auto stub = NewStub(Channel());
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::UploadAssetResponse response;
  const auto writer = stub->UploadAsset(&context, &response);
  v1::UploadAssetRequest request;
  *request.mutable_announce() = asset;
  writer->Write(request);
  for (size_t offset = 0; offset < content.size(); offset += piece_bytes) {
    v1::ByteChunk* chunk = request.mutable_chunk();
    chunk->set_offset(offset);
    chunk->set_data(content.substr(offset, piece_bytes));
    chunk->set_checksum(rpc::Checksum(chunk->data()));
    chunk->set_total_size(content.size());
    if (!writer->Write(request)) break;
  }
  writer->WritesDone();
  return writer->Finish();
}

absl::StatusOr<std::string> FarmFixture::Submit(const v1::JobSpec& spec, const std::string& request_id) {
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::SubmitJobRequest request;
  *request.mutable_spec() = spec;
  request.set_request_id(request_id);
  v1::SubmitJobResponse response;
  const absl::Status status =
      rpc::StatusFromGrpc(NewStub(Channel())->SubmitJob(&context, request, &response));
  if (!status.ok()) return status;
  return response.job_id();
}

absl::StatusOr<v1::JobStatus> FarmFixture::Get(const std::string& job_id) {
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::GetJobRequest request;
  request.set_job_id(job_id);
  v1::JobStatus response;
  const absl::Status status = rpc::StatusFromGrpc(NewStub(Channel())->GetJob(&context, request, &response));
  if (!status.ok()) return status;
  return response;
}

v1::JobStatus FarmFixture::WaitUntil(const std::string& job_id,
                                     const std::function<bool(const v1::JobStatus&)>& condition) {
  const auto stub = NewStub(Channel());
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::WatchJobRequest request;
  request.set_job_id(job_id);
  const auto reader = stub->WatchJob(&context, request);
  v1::JobStatus status;
  while (reader->Read(&status)) {
    if (condition(status)) {
      context.TryCancel();
      reader->Finish();
      return status;
    }
  }
  ADD_FAILURE() << "the watch ended first: " << reader->Finish().error_message() << " "
                << status.ShortDebugString();
  return status;
}

v1::JobStatus FarmFixture::WaitForEnd(const std::string& job_id) {
  return WaitUntil(job_id, [](const v1::JobStatus& status) { return job::HasEnded(status.state()); });
}

void FarmFixture::WaitFor(const std::function<bool()>& condition) {
  const absl::Time deadline = absl::Now() + kPatience;
  while (!condition() && absl::Now() < deadline) absl::SleepFor(absl::Milliseconds(5));
  EXPECT_TRUE(condition());
}

absl::StatusOr<std::string> FarmFixture::Download(const std::string& job_id, int32_t frame, uint64_t offset) {
  const auto stub = NewStub(Channel());
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::DownloadResultRequest request;
  request.set_job_id(job_id);
  request.set_frame(frame);
  request.set_offset(offset);
  const auto reader = stub->DownloadResult(&context, request);
  std::string bytes;
  v1::ByteChunk chunk;
  while (reader->Read(&chunk)) {
    EXPECT_EQ(chunk.offset(), offset + bytes.size());
    EXPECT_EQ(chunk.checksum(), rpc::Checksum(chunk.data()));
    bytes += chunk.data();
  }
  const absl::Status status = rpc::StatusFromGrpc(reader->Finish());
  if (!status.ok()) return status;
  return bytes;
}

std::string FarmFixture::RenderUndisturbed() {
  const absl::StatusOr<std::string> job = Submit(Spec(), "undisturbed");
  EXPECT_TRUE(job.ok()) << job.status();
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(*job).state(), v1::JOB_STATE_DONE);
  return *Download(*job, 0);
}

}  // namespace lumifold::server
