// A client for tests that loads the coordinator in ways a user's would not. It prints what it did to standard
// output.
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <signal.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/blocking_counter.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/sha256.h"
#include "tests/support/hostile_texts.h"

namespace lumifold {
namespace {

/// Connections over which the calls of a flood are spread.
constexpr int kChannels = 8;
constexpr std::chrono::seconds kDeadline(120);
constexpr uint64_t kTebibyte = uint64_t{1} << 40;

struct Options {
  std::string server;
  rpc::Security security;
  std::string scene;
  int count = 1000;
};

/// A stub on a connection of its own: gRPC shares connections between channels with equal arguments.
std::unique_ptr<v1::FarmService::Stub> MakeStub(const std::string& server, int number) {
  grpc::ChannelArguments arguments;
  arguments.SetInt("lumifold.test.channel", number);
  return v1::FarmService::NewStub(
      grpc::CreateCustomChannel(server, rpc::MakeChannelCredentials(rpc::Security{}), arguments));
}

std::string ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

v1::SubmitJobRequest MakeRequest(const std::string& scene, int number) {
  v1::SubmitJobRequest request;
  v1::JobSpec* spec = request.mutable_spec();
  spec->mutable_scene()->mutable_file()->set_sha256(rpc::Sha256Hex(scene));
  spec->mutable_scene()->mutable_file()->set_size(scene.size());
  spec->mutable_scene()->set_display_name("flood");
  spec->set_width(8);
  spec->set_height(8);
  spec->set_frame_count(1);
  spec->set_samples_per_pixel(1);
  spec->mutable_filter()->set_method("none");
  request.set_request_id(absl::StrCat("flood-", number));
  return request;
}

/// One call of a flood.
template <typename Request, typename Response>
struct Call {
  grpc::ClientContext context;
  Request request;
  Response response;
  grpc::Status status;
};

/// Makes all calls at the same time; returns how many failed.
template <typename Method, typename Calls>
int CallAll(const std::vector<std::unique_ptr<v1::FarmService::Stub>>& stubs, Method method, Calls& calls) {
  absl::BlockingCounter left(static_cast<int>(calls.size()));
  for (size_t i = 0; i < calls.size(); ++i) {
    auto& call = calls[i];
    call.context.set_deadline(std::chrono::system_clock::now() + kDeadline);
    method(*stubs[i % stubs.size()]->async(), call, [&call, &left](const grpc::Status& status) {
      call.status = status;
      left.DecrementCount();
    });
  }
  left.Wait();
  int failed = 0;
  for (const auto& call : calls) {
    if (call.status.ok()) continue;
    if (++failed == 1) std::fprintf(stderr, "%s\n", call.status.error_message().c_str());
  }
  return failed;
}

/// Submits jobs at the same time, prints their ids, and cancels them all at the same time.
int Submit(const Options& options) {
  std::vector<std::unique_ptr<v1::FarmService::Stub>> stubs;
  stubs.reserve(kChannels);
  for (int i = 0; i < kChannels; ++i) stubs.push_back(MakeStub(options.server, i));
  const std::string scene = ReadFile(options.scene);
  std::vector<Call<v1::SubmitJobRequest, v1::SubmitJobResponse>> submissions(
      static_cast<size_t>(options.count));
  for (int i = 0; i < options.count; ++i) submissions[static_cast<size_t>(i)].request = MakeRequest(scene, i);
  const int failed = CallAll(
      stubs,
      [](auto& async, auto& call, auto done) {
        async.SubmitJob(&call.context, &call.request, &call.response, done);
      },
      submissions);
  for (const auto& call : submissions) {
    if (call.status.ok()) std::printf("%s\n", call.response.job_id().c_str());
  }
  std::fflush(stdout);
  std::getchar();  // the test looks at the jobs meanwhile
  std::vector<Call<v1::CancelJobRequest, v1::JobStatus>> cancels(submissions.size());
  for (size_t i = 0; i < cancels.size(); ++i) cancels[i].request.set_job_id(submissions[i].response.job_id());
  const int kept = CallAll(
      stubs,
      [](auto& async, auto& call, auto done) {
        async.CancelJob(&call.context, &call.request, &call.response, done);
      },
      cancels);
  return failed + kept == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

/// Begins uploads, sends half of each, and leaves them open until it is killed.
int Upload(const Options& options) {
  struct Open {
    grpc::ClientContext context;
    v1::UploadAssetResponse response;
    std::unique_ptr<v1::FarmService::Stub> stub;
    std::unique_ptr<grpc::ClientWriter<v1::UploadAssetRequest>> writer;
  };
  std::vector<Open> uploads(static_cast<size_t>(options.count));
  for (size_t i = 0; i < uploads.size(); ++i) {
    const std::string content(200'000, static_cast<char>('a' + i % 26));
    const std::string name = absl::StrCat(content, i);
    Open& upload = uploads[i];
    upload.stub = MakeStub(options.server, static_cast<int>(i));
    upload.writer = upload.stub->UploadAsset(&upload.context, &upload.response);
    v1::UploadAssetRequest request;
    request.mutable_announce()->set_sha256(rpc::Sha256Hex(name));
    request.mutable_announce()->set_size(name.size());
    bool sent = upload.writer->Write(request);
    v1::ByteChunk* chunk = request.mutable_chunk();
    chunk->set_data(name.substr(0, name.size() / 2));
    chunk->set_checksum(rpc::Checksum(chunk->data()));
    chunk->set_total_size(name.size());
    sent = sent && upload.writer->Write(request);
    if (!sent) {
      std::fprintf(stderr, "upload %zu: %s\n", i, upload.writer->Finish().error_message().c_str());
      return EXIT_FAILURE;
    }
  }
  std::printf("%d uploads are open\n", options.count);
  std::fflush(stdout);
  std::getchar();
  std::_Exit(EXIT_SUCCESS);  // without ending the calls
}

/// Announces uploads of 1 TiB and sends nothing of them, all at the same time.
int Announce(const Options& options) {
  struct Announced {
    grpc::ClientContext context;
    v1::UploadAssetResponse response;
    std::unique_ptr<grpc::ClientWriter<v1::UploadAssetRequest>> writer;
  };
  const auto stub = MakeStub(options.server, 0);
  std::vector<Announced> uploads(static_cast<size_t>(options.count));
  for (size_t i = 0; i < uploads.size(); ++i) {
    uploads[i].context.set_deadline(std::chrono::system_clock::now() + kDeadline);
    uploads[i].writer = stub->UploadAsset(&uploads[i].context, &uploads[i].response);
    v1::UploadAssetRequest request;
    request.mutable_announce()->set_sha256(rpc::Sha256Hex(absl::StrCat("announced ", i)));
    request.mutable_announce()->set_size(kTebibyte);
    uploads[i].writer->Write(request);
  }
  int refused = 0;
  std::string error;
  for (Announced& upload : uploads) {
    const grpc::Status status = upload.writer->Finish();
    if (status.error_code() != grpc::StatusCode::RESOURCE_EXHAUSTED &&
        status.error_code() != grpc::StatusCode::INVALID_ARGUMENT)
      continue;
    ++refused;
    error = status.error_message();
  }
  std::printf("%d of %d refused: %s\n", refused, options.count, error.c_str());
  return EXIT_SUCCESS;
}

/// Asks for the coordinator's status, all at the same time.
int AskOften(const Options& options) {
  std::vector<std::unique_ptr<v1::FarmService::Stub>> stubs;
  stubs.reserve(kChannels);
  for (int i = 0; i < kChannels; ++i) stubs.push_back(MakeStub(options.server, i));
  std::vector<Call<v1::GetServerStatusRequest, v1::ServerStatus>> calls(static_cast<size_t>(options.count));
  const int failed = CallAll(
      stubs,
      [](auto& async, auto& call, auto done) {
        async.GetServerStatus(&call.context, &call.request, &call.response, done);
      },
      calls);
  std::printf("%d answered, %d refused\n", options.count - failed, failed);
  return EXIT_SUCCESS;
}

/// Makes the calls of standard input, one path a line, each with an empty message, and prints their codes.
int CallEach(const Options& options) {
  const std::shared_ptr<grpc::Channel> channel = rpc::MakeChannel(options.server, options.security);
  grpc::GenericStub stub(channel);
  std::string path;
  while (std::getline(std::cin, path)) {
    const grpc::StatusCode code = CallByPath(&stub, path, "");
    std::printf("%s %s\n", path.c_str(),
                absl::StatusCodeToString(static_cast<absl::StatusCode>(code)).c_str());
  }
  return EXIT_SUCCESS;
}

}  // namespace
}  // namespace lumifold

int main(int argc, char** argv) {
  setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);
  signal(SIGPIPE, SIG_IGN);
  CLI::App app("A client that loads the coordinator, for tests.", "hostile-client");
  lumifold::Options options;
  app.add_option("--server", options.server, "Coordinator, HOST:PORT")->required();
  app.add_option("--count", options.count, "Number of jobs or uploads")->check(CLI::PositiveNumber);
  CLI::App* submit =
      app.add_subcommand("submit", "Submit jobs at once; cancel them at the end of standard input");
  submit->add_option("--scene", options.scene, "Scene file; it must be stored already")->required();
  app.add_subcommand("upload", "Leave uploads half done until the end of standard input");
  CLI::App* announce = app.add_subcommand("announce", "Announce uploads of 1 TiB");
  CLI::App* status = app.add_subcommand("status", "Ask for the coordinator's status at once");
  app.add_option("--ca", options.security.ca_path, "Use TLS: the authority of the server's certificate");
  app.add_option("--certificate", options.security.certificate_path, "Key and certificate of a worker");
  std::string token_file;
  app.add_option("--token", token_file, "File with a person's token");
  CLI::App* call = app.add_subcommand("call", "Make the calls of standard input");
  CLI::App* strings = app.add_subcommand("strings", "Make every call with tricks in its texts");
  app.require_subcommand(1);
  CLI11_PARSE(app, argc, argv);
  if (!token_file.empty())
    options.security.token = std::string(absl::StripAsciiWhitespace(lumifold::ReadFile(token_file)));
  if (call->parsed()) return lumifold::CallEach(options);
  if (announce->parsed()) return lumifold::Announce(options);
  if (status->parsed()) return lumifold::AskOften(options);
  if (strings->parsed()) return lumifold::SendHostileTexts(options.server) ? EXIT_SUCCESS : EXIT_FAILURE;
  return submit->parsed() ? lumifold::Submit(options) : lumifold::Upload(options);
}
