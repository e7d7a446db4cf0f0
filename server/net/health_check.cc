#include "server/net/health_check.h"

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <memory>

#include "absl/strings/str_cat.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::server {
namespace {

constexpr char kCheck[] = "/grpc.health.v1.Health/Check";
/// HealthCheckResponse with `status: SERVING`, encoded. Debian's gRPC does not install the generated code of
/// the service.
constexpr char kServing[] = "\x08\x01";

}  // namespace

absl::Status CheckHealth(const HealthCheckOptions& options) {
  if (absl::Status status = rpc::CheckServerAddress(options.address, options.security); !status.ok())
    return status;
  grpc::GenericStub stub(rpc::MakeChannel(options.address, options.security));
  grpc::ClientContext context;
  context.set_deadline(rpc::MonotonicDeadline(options.timeout));
  grpc::CompletionQueue queue;
  const grpc::Slice request;  // the whole server
  const std::unique_ptr<grpc::GenericClientAsyncResponseReader> call =
      stub.PrepareUnaryCall(&context, kCheck, grpc::ByteBuffer(&request, 1), &queue);
  grpc::ByteBuffer response;
  grpc::Status status;
  call->StartCall();
  call->Finish(&response, &status, nullptr);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  if (!status.ok())
    return absl::UnavailableError(
        absl::StrCat("the coordinator at ", options.address, " does not answer: ", status.error_message()));
  grpc::Slice bytes;
  const bool serves = response.DumpToSingleSlice(&bytes).ok() &&
                      std::string(reinterpret_cast<const char*>(bytes.begin()), bytes.size()) == kServing;
  if (serves || options.answers_only) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat("the coordinator at ", options.address,
                   " does not serve: its storage cannot be written, or it is stopping"));
}

}  // namespace lumifold::server
