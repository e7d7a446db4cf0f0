#include "server/access/access_adapter.h"

#include <grpcpp/server_context.h>

#include <utility>

#include "absl/functional/function_ref.h"
#include "lumifold/v1/access.grpc.pb.h"
#include "proto/rpc/status_codec.h"
#include "server/access/access_control.h"

namespace lumifold::access {
namespace {

using Context = grpc::CallbackServerContext;
using Reactor = grpc::ServerUnaryReactor;

template <typename Response>
Reactor* Answer(Context* context, absl::StatusOr<Response> result, Response* response) {
  Reactor* reactor = context->DefaultReactor();
  if (result.ok()) *response = *std::move(result);
  reactor->Finish(rpc::GrpcFromStatus(result.status()));
  return reactor;
}

class AccessServiceAdapter final : public v1::AccessService::CallbackService {
 public:
  AccessServiceAdapter(AccessControl* access, const Callers* callers) : access_(access), callers_(callers) {}

  Reactor* Enroll(Context* context, const v1::EnrollRequest* request,
                  v1::CertificateResponse* response) override {
    return Answer<v1::CertificateResponse>(
        context, access_ == nullptr ? NoAccessControl() : access_->Enroll(*request), response);
  }
  Reactor* Login(Context* context, const v1::LoginRequest* request, v1::LoginResponse* response) override {
    return Answer<v1::LoginResponse>(
        context, access_ == nullptr ? NoAccessControl() : access_->Login(*request), response);
  }
  Reactor* RenewCertificate(Context* context, const v1::RenewCertificateRequest* request,
                            v1::CertificateResponse* response) override {
    return AnswerCaller<v1::CertificateResponse>(context, response, [&](const Identity& caller) {
      return access_->RenewCertificate(caller, *request);
    });
  }
  Reactor* WhoAmI(Context* context, const v1::WhoAmIRequest*, v1::WhoAmIResponse* response) override {
    const absl::StatusOr<Identity> caller = callers_->Of(*context);
    if (!caller.ok()) return Answer<v1::WhoAmIResponse>(context, caller.status(), response);
    return Answer<v1::WhoAmIResponse>(context, DescribeCaller(access_, *caller), response);
  }
  Reactor* CreateInvite(Context* context, const v1::CreateInviteRequest* request,
                        v1::CreateInviteResponse* response) override {
    return AnswerCaller<v1::CreateInviteResponse>(
        context, response, [&](const Identity& caller) { return access_->CreateInvite(caller, *request); });
  }
  Reactor* ListIdentities(Context* context, const v1::ListIdentitiesRequest* request,
                          v1::ListIdentitiesResponse* response) override {
    return AnswerCaller<v1::ListIdentitiesResponse>(
        context, response, [&](const Identity&) { return access_->ListIdentities(*request); });
  }
  Reactor* Revoke(Context* context, const v1::RevokeRequest* request, v1::RevokeResponse* response) override {
    return AnswerCaller<v1::RevokeResponse>(
        context, response, [&](const Identity& caller) { return access_->Revoke(caller, *request); });
  }

 private:
  static absl::Status NoAccessControl() {
    return absl::FailedPreconditionError(
        "this coordinator has no access control: it was not set up with 'lumifold-server init'");
  }

  template <typename Response>
  Reactor* AnswerCaller(Context* context, Response* response,
                        absl::FunctionRef<absl::StatusOr<Response>(const Identity&)> call) {
    if (access_ == nullptr) return Answer<Response>(context, NoAccessControl(), response);
    const absl::StatusOr<Identity> caller = callers_->Of(*context);
    return Answer<Response>(context, caller.ok() ? call(*caller) : caller.status(), response);
  }

  AccessControl* const access_;
  const Callers* const callers_;
};

}  // namespace

std::unique_ptr<grpc::Service> MakeAccessService(AccessControl* access, const Callers* callers) {
  return std::make_unique<AccessServiceAdapter>(access, callers);
}

}  // namespace lumifold::access
