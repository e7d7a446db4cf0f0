#include "client/access_client.h"

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <utility>

#include "lumifold/v1/access.grpc.pb.h"
#include "proto/rpc/status_codec.h"

namespace lumifold::client {
namespace {

using Stub = v1::AccessService::Stub;

class GrpcAccessClient final : public AccessClient {
 public:
  explicit GrpcAccessClient(FarmClientOptions options)
      : stub_(v1::AccessService::NewStub(rpc::MakeChannel(options.coordinator, options.security))),
        options_(std::move(options)) {}

  absl::StatusOr<v1::WhoAmIResponse> WhoAmI() override {
    return Call(rpc::Idempotency::kIdempotent, &Stub::WhoAmI, v1::WhoAmIRequest());
  }
  absl::StatusOr<v1::CreateInviteResponse> CreateInvite(const v1::CreateInviteRequest& request) override {
    return Call(rpc::Idempotency::kNotIdempotent, &Stub::CreateInvite, request);
  }
  absl::StatusOr<v1::ListIdentitiesResponse> ListIdentities(
      const v1::ListIdentitiesRequest& request) override {
    return Call(rpc::Idempotency::kIdempotent, &Stub::ListIdentities, request);
  }
  absl::StatusOr<v1::RevokeResponse> Revoke(const v1::RevokeRequest& request) override {
    return Call(rpc::Idempotency::kIdempotent, &Stub::Revoke, request);
  }

 private:
  template <typename Request, typename Response>
  absl::StatusOr<Response> Call(rpc::Idempotency idempotency,
                                grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                                const Request& request) {
    const rpc::RetryPolicy policy = {
        .try_timeout = absl::Seconds(10), .total_timeout = absl::Seconds(20), .max_tries = 3};
    Response response;
    const absl::Status status =
        rpc::CallWithRetry(policy, idempotency, options_.time, [&](grpc::ClientContext& context) {
          return rpc::StatusFromGrpc((stub_.get()->*method)(&context, request, &response));
        });
    if (status.ok()) return response;
    if (options_.interrupted()) return absl::CancelledError("interrupted");
    if (!rpc::IsTransient(status)) return status;
    return CannotReach(options_.coordinator, status.message());
  }

  const std::unique_ptr<Stub> stub_;
  const FarmClientOptions options_;
};

}  // namespace

std::unique_ptr<AccessClient> ConnectToAccess(FarmClientOptions options) {
  return std::make_unique<GrpcAccessClient>(std::move(options));
}

}  // namespace lumifold::client
