#include "tests/unit/server/gate_fixture.h"

#include <grpcpp/generic/generic_stub.h>

#include <map>
#include <utility>

#include "absl/strings/str_split.h"
#include "filter/image/file_io.h"
#include "server/services/farm_service.h"
#include "server/services/worker_service.h"

namespace lumifold::server {

absl::StatusOr<access::Identity> BelievedCallers::Of(const grpc::CallbackServerContext& context) const {
  const auto& metadata = context.client_metadata();
  const auto found = metadata.find("caller");
  if (found == metadata.end()) return absl::UnauthenticatedError("this needs a token");
  const std::vector<std::string> parts =
      absl::StrSplit(std::string(found->second.data(), found->second.size()), '/');
  if (parts[0] == "local") return access::LocalIdentity();
  static const std::map<std::string, access::Scope> kScopes = {
      {"read", access::Scope::kRead}, {"submit", access::Scope::kSubmit}, {"admin", access::Scope::kAdmin}};
  access::Identity caller{.name = parts[1], .scopes = {}, .id = "id-of-" + parts[1]};
  if (parts[0] == "worker") {
    caller.kind = access::IdentityKind::kWorker;
  } else {
    caller.scopes.insert(kScopes.at(parts[2]));
  }
  return caller;
}

void GateFixture::StartGate(const CallLimits& calls, const JobLimits& jobs) {
  options_.limits = jobs;
  options_.job_log.events = &events_;
  if (coordinator_ == nullptr) {
    ASSERT_TRUE(Start().ok());
  }
  audit_ = *access::AuditLog::Open({.path = folder_.PathOf("audit.log")});
  checks_ = std::make_unique<AssetChecks>(assets_.get());
  gate_ =
      std::make_unique<CallGate>(CallGate::Options{.callers = &callers_,
                                                   .open_calls = &open_calls_,
                                                   .audit = audit_.get(),
                                                   .limits = calls,
                                                   .now = [this] { return Now(); },
                                                   .wall_now = [] { return absl::UnixEpoch(); },
                                                   .shut_out = [this](absl::string_view) { ++shut_out_; }});
  previews_ = std::make_unique<PreviewMaker>(
      PreviewOptions{.make = [](const job::JobId&, int32_t,
                                const PreviewRequest&) { return absl::OutOfRangeError("no preview here"); },
                     .count_units = [this](const job::JobId& job,
                                           int32_t frame) { return coordinator_->CountUnits(job, frame); }});
  services_ = MakeServices({.submissions = &coordinator_->submissions(),
                            .jobs = &coordinator_->jobs(),
                            .changes = &coordinator_->changes(),
                            .operators = &coordinator_->operators(),
                            .workers = &coordinator_->workers(),
                            .traffic = &coordinator_->resources().traffic,
                            .epoch = coordinator_->resources().owner.epoch,
                            .checks = checks_.get(),
                            .gate = gate_.get(),
                            .peers = &peers_,
                            .previews = previews_.get(),
                            .make_link = [](const std::string&, const v1::CreatePageLinkRequest&) {
                              return absl::FailedPreconditionError("no page here");
                            }});
  grpc::ServerBuilder builder;
  for (const auto& service : services_) builder.RegisterService(service.get());
  server_ = builder.BuildAndStart();
  channel_ = server_->InProcessChannel({});
  farm_ = v1::FarmService::NewStub(channel_);
  workers_ = v1::WorkerService::NewStub(channel_);
}

absl::Time GateFixture::Now() {
  ++clock_reads_;
  return absl::UnixEpoch() + absl::Seconds(seconds_.load());
}

void GateFixture::StopGate() {
  if (server_ == nullptr) return;
  coordinator_->StopLeasing();
  checks_->Stop();
  previews_->Stop();
  server_->Shutdown(std::chrono::system_clock::now());
  server_.reset();
  audit_.reset();
}

std::unique_ptr<grpc::ClientContext> GateFixture::As(const std::string& caller) {
  auto context = std::make_unique<grpc::ClientContext>();
  if (!caller.empty()) context->AddMetadata("caller", caller);
  return context;
}

grpc::Status GateFixture::CallByPath(const std::string& caller, const std::string& path) {
  grpc::GenericStub stub(channel_);
  const auto context = As(caller);
  grpc::CompletionQueue queue;
  const auto wait = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  const auto call = stub.PrepareCall(context.get(), path, &queue);
  call->StartCall(nullptr);
  wait();
  call->WriteLast(grpc::ByteBuffer(nullptr, 0), {}, nullptr);
  wait();
  grpc::ByteBuffer answer;
  call->Read(&answer, nullptr);
  const bool answered = wait();
  grpc::Status status;
  call->Finish(&status, nullptr);
  wait();
  queue.Shutdown();
  void* tag = nullptr;
  bool ok = false;
  while (queue.Next(&tag, &ok)) {
  }
  return answered && !status.ok() ? grpc::Status::OK : status;
}

grpc::Status GateFixture::SubmitAs(const std::string& caller, const std::string& request_id,
                                   const std::string& user, std::string* job_id) {
  v1::SubmitJobRequest request;
  *request.mutable_spec() = Spec();
  request.set_request_id(request_id);
  request.mutable_scheduling()->set_user(user);
  v1::SubmitJobResponse response;
  grpc::Status status = Call(caller, &v1::FarmService::Stub::SubmitJob, request, &response);
  if (job_id != nullptr) *job_id = response.job_id();
  return status;
}

void GateFixture::StoreScene() {
  const job::JobId job = Submit(Spec(), "for its scene");
  coordinator_->changes().CancelJob(job.value(), [](const absl::StatusOr<v1::JobStatus>&) {});
}

std::string GateFixture::AuditText() {
  StopGate();
  return ReadFile(folder_.PathOf("audit.log"), 1 << 24).value_or("");
}

}  // namespace lumifold::server
