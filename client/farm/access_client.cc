#include "client/farm/access_client.h"

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <utility>

#include "lumifold/v1/access.grpc.pb.h"

namespace lumifold::client {
namespace {

using Stub = v1::AccessService::Stub;

class GrpcAccessClient final : public AccessClient {
 public:
  explicit GrpcAccessClient(FarmClientOptions options) : coordinators_(std::move(options)) {}

  absl::StatusOr<v1::WhoAmIResponse> WhoAmI() override { return Call(&Stub::WhoAmI, v1::WhoAmIRequest()); }
  absl::StatusOr<v1::CreateInviteResponse> CreateInvite(const v1::CreateInviteRequest& request) override {
    if (coordinators_.size() > 1) {  // finds one that answers
      if (const auto caller = WhoAmI(); !caller.ok()) return caller.status();
    }
    v1::CreateInviteResponse invite;
    const absl::Status status = coordinators_.CallOnce(
        kShortCall.retry.try_timeout,
        [&](grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
          return v1::AccessService::NewStub(channel)->CreateInvite(&context, request, &invite);
        });
    if (!status.ok()) return status;
    return invite;
  }
  absl::StatusOr<v1::ListIdentitiesResponse> ListIdentities(
      const v1::ListIdentitiesRequest& request) override {
    return Call(&Stub::ListIdentities, request);
  }
  absl::StatusOr<v1::RevokeResponse> Revoke(const v1::RevokeRequest& request) override {
    return Call(&Stub::Revoke, request);
  }

 private:
  template <typename Request, typename Response>
  absl::StatusOr<Response> Call(grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                                const Request& request) {
    Response response;
    const absl::Status status = coordinators_.Call(
        kShortCall, [&](grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
          return (v1::AccessService::NewStub(channel).get()->*method)(&context, request, &response);
        });
    if (!status.ok()) return status;
    return response;
  }

  Coordinators coordinators_;
};

}  // namespace

std::unique_ptr<AccessClient> ConnectToAccess(FarmClientOptions options) {
  return std::make_unique<GrpcAccessClient>(std::move(options));
}

}  // namespace lumifold::client
