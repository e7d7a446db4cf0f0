#include "tests/bench/farm_load_server.h"

#include <fcntl.h>
#include <grpcpp/grpcpp.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/status_codec.h"

extern char** environ;

namespace lumifold::bench {
namespace {

constexpr absl::Duration kCallTimeout = absl::Minutes(1);
constexpr std::string_view kScene = "not read";

void SetDeadline(grpc::ClientContext* context) {
  context->set_deadline(rpc::MonotonicDeadline(kCallTimeout));
  context->set_wait_for_ready(true);
}

}  // namespace

absl::StatusOr<std::unique_ptr<ServerProcess>> ServerProcess::Start(const std::string& program,
                                                                    const std::string& data,
                                                                    const std::string& log_path,
                                                                    const std::vector<std::string>& options) {
  int out[2];
  if (pipe2(out, O_CLOEXEC) != 0) return absl::UnavailableError("no pipe");
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log_path.c_str(), O_WRONLY | O_CREAT | O_APPEND,
                                   0644);
  std::vector<std::string> words = {program, "--data", data, "--listen", "127.0.0.1:0"};
  words.insert(words.end(), options.begin(), options.end());
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  pid_t pid = 0;
  const int error = posix_spawn(&pid, program.c_str(), &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(out[1]);
  const std::unique_ptr<FILE, int (*)(FILE*)> lines(fdopen(out[0], "r"), &fclose);
  if (error != 0) return absl::UnavailableError(absl::StrCat("cannot start ", program));
  std::unique_ptr<ServerProcess> server(new ServerProcess(pid));
  char address[256];
  if (fscanf(lines.get(), "listening on %255s", address) != 1)
    return absl::UnavailableError(absl::StrCat(program, " does not listen; its log is ", log_path));
  server->address_ = address;
  return server;
}

ServerProcess::~ServerProcess() { End(SIGTERM); }

void ServerProcess::End(int signal) {
  if (pid_ == 0) return;
  kill(pid_, signal);
  waitpid(pid_, nullptr, 0);
  pid_ = 0;
}

int ServerProcess::SignalChildren(int signal) const {
  int count = 0;
  const std::string tasks = absl::StrCat("/proc/", pid_, "/task");
  for (const std::filesystem::directory_entry& task : std::filesystem::directory_iterator(tasks)) {
    std::ifstream children(task.path() / "children");
    for (pid_t child = 0; children >> child; ++count) kill(child, signal);
  }
  return count;
}

double ServerProcess::cpu_seconds() const {
  clockid_t clock;
  timespec time = {};
  if (clock_getcpuclockid(pid_, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

int64_t ServerProcess::rss_bytes() const {
  int64_t total = 0;
  int64_t resident = 0;
  std::ifstream(absl::StrCat("/proc/", pid_, "/statm")) >> total >> resident;
  return resident * sysconf(_SC_PAGESIZE);
}

Client::Client(const std::string& address, const rpc::Security& security)
    : stub_(v1::FarmService::NewStub(rpc::MakeChannel(address, security))) {}

absl::StatusOr<v1::SceneRef> Client::UploadScene() {
  v1::SceneRef scene;
  scene.mutable_file()->set_sha256(rpc::Sha256Hex(kScene));
  scene.mutable_file()->set_size(kScene.size());
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::UploadAssetResponse response;
  const auto writer = stub_->UploadAsset(&context, &response);
  v1::UploadAssetRequest request;
  *request.mutable_announce() = scene.file();
  writer->Write(request);
  v1::ByteChunk* chunk = request.mutable_chunk();
  chunk->set_data(kScene.data(), kScene.size());
  chunk->set_checksum(rpc::Checksum(kScene));
  chunk->set_total_size(kScene.size());
  writer->Write(request);
  writer->WritesDone();
  if (absl::Status status = rpc::StatusFromGrpc(writer->Finish()); !status.ok()) return status;
  return scene;
}

absl::StatusOr<std::string> Client::Submit(const v1::JobSpec& spec, const std::string& request_id) {
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::SubmitJobRequest request;
  *request.mutable_spec() = spec;
  request.set_request_id(request_id);
  v1::SubmitJobResponse response;
  if (absl::Status status = rpc::StatusFromGrpc(stub_->SubmitJob(&context, request, &response)); !status.ok())
    return status;
  return response.job_id();
}

absl::Status Client::Cancel(const std::string& job_id) {
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::CancelJobRequest request;
  request.set_job_id(job_id);
  v1::JobStatus response;
  return rpc::StatusFromGrpc(stub_->CancelJob(&context, request, &response));
}

absl::StatusOr<v1::JobStatus> Client::Status(const std::string& job_id) {
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::GetJobRequest request;
  request.set_job_id(job_id);
  v1::JobStatus response;
  if (absl::Status status = rpc::StatusFromGrpc(stub_->GetJob(&context, request, &response)); !status.ok())
    return status;
  return response;
}

absl::StatusOr<v1::ListJobsResponse> Client::List(int limit, const std::string& page_token) {
  grpc::ClientContext context;
  SetDeadline(&context);
  v1::ListJobsRequest request;
  request.set_limit(limit);
  request.set_page_token(page_token);
  v1::ListJobsResponse response;
  if (absl::Status status = rpc::StatusFromGrpc(stub_->ListJobs(&context, request, &response)); !status.ok())
    return status;
  return response;
}

}  // namespace lumifold::bench
