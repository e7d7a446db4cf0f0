#include "server/services/access_service.h"

#include <utility>

#include "lumifold/v1/access.grpc.pb.h"
#include "server/access/access_control.h"
#include "server/services/unary_calls.h"

namespace lumifold::server {
namespace {

using Context = grpc::CallbackServerContext;
using Reactor = grpc::ServerUnaryReactor;

class AccessServiceAdapter final : public v1::AccessService::CallbackService {
 public:
  AccessServiceAdapter(access::AccessControl* access, CallGate* gate)
      : access_(access), gate_(gate, v1::AccessService::service_full_name()) {}

  // The subject is never the code, which is a secret; who it was for is known afterwards.
  Reactor* Enroll(Context* context, const v1::EnrollRequest* request,
                  v1::CertificateResponse* response) override {
    return AnswerCall(context, "Enroll", "", response,
                      [&](const access::Identity&) { return access_->Enroll(*request); });
  }
  Reactor* Login(Context* context, const v1::LoginRequest* request, v1::LoginResponse* response) override {
    return AnswerCall(context, "Login", "", response,
                      [&](const access::Identity&) { return access_->Login(*request); });
  }
  Reactor* RenewCertificate(Context* context, const v1::RenewCertificateRequest* request,
                            v1::CertificateResponse* response) override {
    return AnswerCall(context, "RenewCertificate", "", response, [&](const access::Identity& caller) {
      return access_->RenewCertificate(caller, *request);
    });
  }
  Reactor* WhoAmI(Context* context, const v1::WhoAmIRequest*, v1::WhoAmIResponse* response) override {
    return Answer(context, gate_.Admit(context, "WhoAmI", ""), response,
                  [&](const CallGate::Call& call) { return access::DescribeCaller(access_, call.caller()); });
  }
  Reactor* CreateInvite(Context* context, const v1::CreateInviteRequest* request,
                        v1::CreateInviteResponse* response) override {
    return AnswerCall(
        context, "CreateInvite", request->name(), response,
        [&](const access::Identity& caller) { return access_->CreateInvite(caller, *request); });
  }
  Reactor* ListIdentities(Context* context, const v1::ListIdentitiesRequest* request,
                          v1::ListIdentitiesResponse* response) override {
    return AnswerCall(context, "ListIdentities", "", response,
                      [&](const access::Identity&) { return access_->ListIdentities(*request); });
  }
  Reactor* Revoke(Context* context, const v1::RevokeRequest* request, v1::RevokeResponse* response) override {
    const std::string& subject = request->id().empty() ? request->name() : request->id();
    return AnswerCall(context, "Revoke", subject, response,
                      [&](const access::Identity& caller) { return access_->Revoke(caller, *request); });
  }

 private:
  /// Answers a call that needs access control.
  template <typename Response, typename Make>
  Reactor* AnswerCall(Context* context, const char* method, const std::string& subject, Response* response,
                      Make make) {
    return Answer(
        context, gate_.Admit(context, method, subject), response,
        [&](const CallGate::Call& call) -> absl::StatusOr<Response> {
          if (access_ != nullptr) return make(call.caller());
          return absl::FailedPreconditionError(
              "this coordinator has no access control: it was not set up with 'lumifold-server init'");
        });
  }

  access::AccessControl* const access_;
  const ServiceGate gate_;
};

}  // namespace

std::unique_ptr<grpc::Service> MakeAccessService(access::AccessControl* access, CallGate* gate) {
  return std::make_unique<AccessServiceAdapter>(access, gate);
}

}  // namespace lumifold::server
