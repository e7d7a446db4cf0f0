#include "server/access/caller_check.h"

#include <grpc/grpc_security_constants.h>
#include <grpcpp/security/auth_context.h>
#include <grpcpp/security/auth_metadata_processor.h>
#include <grpcpp/server_context.h>

#include <map>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/strip.h"
#include "proto/rpc/status_codec.h"
#include "server/access/authorisation.h"
#include "server/access/certificate_authority.h"
#include "server/access/forward_seal.h"

namespace lumifold::access {
namespace {

using Metadata = std::multimap<grpc::string_ref, grpc::string_ref>;

constexpr char kPathKey[] = ":path";
constexpr char kTokenKey[] = "authorization";
constexpr absl::string_view kTokenScheme = "Bearer ";

absl::string_view View(const grpc::string_ref& text) { return {text.data(), text.size()}; }

/// The serial number in a certificate that the handshake has verified; empty where there is none.
std::string SerialOf(const grpc::AuthContext& context) {
  for (const grpc::string_ref& uri : context.FindPropertyValues(GRPC_PEER_URI_PROPERTY_NAME)) {
    absl::string_view rest = View(uri);
    if (absl::ConsumePrefix(&rest, kSerialUri)) return std::string(rest);
  }
  return "";
}

absl::StatusOr<Identity> IdentityOf(const KnownCredentials& known, const grpc::AuthContext& context,
                                    const Metadata& metadata, absl::Time now) {
  const bool has_certificate = !context.FindPropertyValues(GRPC_X509_PEM_CERT_PROPERTY_NAME).empty();
  const size_t tokens = metadata.count(kTokenKey);
  // Two would leave open in whose name the call is made.
  const size_t seals = metadata.count(kForwardedKey);
  if (tokens + seals + (has_certificate ? 1 : 0) > 1)
    return absl::UnauthenticatedError("a call has one token or one certificate");
  if (seals == 1) {
    const absl::string_view seal = View(metadata.find(kForwardedKey)->second);
    const absl::StatusOr<Credential> found = known.OfSeal({seal.data(), seal.size()}, now);
    if (!found.ok()) return found.status();
    return found->identity();
  }
  if (has_certificate) {
    const absl::StatusOr<Credential> found = known.OfCertificate(SerialOf(context), now);
    if (!found.ok()) return found.status();
    return found->identity();
  }
  if (tokens == 0)
    return absl::UnauthenticatedError("this needs a token or a certificate; see 'lumifold login'");
  absl::string_view token = View(metadata.find(kTokenKey)->second);
  if (!absl::ConsumePrefix(&token, kTokenScheme)) return absl::UnauthenticatedError("the token is not valid");
  const absl::StatusOr<Credential> found = known.OfToken({token.data(), token.size()}, now);
  if (!found.ok()) return found.status();
  return found->identity();
}

class CallerCheck final : public grpc::AuthMetadataProcessor {
 public:
  CallerCheck(const KnownCredentials* known, const Authoriser* authoriser,
              std::function<absl::Time()> wall_now, RefusalListener on_refusal)
      : known_(known),
        authoriser_(authoriser),
        wall_now_(std::move(wall_now)),
        on_refusal_(std::move(on_refusal)) {}

  // It looks things up in memory.
  bool IsBlocking() const override { return false; }

  grpc::Status Process(const InputMetadata& metadata, grpc::AuthContext* context, OutputMetadata*,
                       OutputMetadata*) override {
    return rpc::GrpcFromStatus(Check(metadata, *context));
  }

 private:
  absl::Status Check(const InputMetadata& metadata, const grpc::AuthContext& context) const {
    const auto path = metadata.find(kPathKey);
    if (path == metadata.end()) return absl::UnauthenticatedError("the call has no path");
    const Rule* rule = FindRule(View(path->second));
    if (rule != nullptr && rule->checked_by_service) return absl::OkStatus();
    if (AccessOf(Role::kNobody, View(path->second)) == Access::kYes) return absl::OkStatus();
    const absl::StatusOr<Identity> caller = IdentityOf(*known_, context, metadata, wall_now_());
    absl::Status status = caller.ok() ? authoriser_->Check(*caller, View(path->second)) : caller.status();
    if (!status.ok()) on_refusal_(caller.value_or(Identity()), rule == nullptr ? "" : rule->rpc_path, status);
    return status;
  }

  const KnownCredentials* const known_;
  const Authoriser* const authoriser_;
  const std::function<absl::Time()> wall_now_;
  const RefusalListener on_refusal_;
};

class CheckedCallers final : public Callers {
 public:
  CheckedCallers(const KnownCredentials* known, std::function<absl::Time()> wall_now)
      : known_(known), wall_now_(std::move(wall_now)) {}

  absl::StatusOr<Identity> Of(const grpc::CallbackServerContext& context) const override {
    const std::shared_ptr<const grpc::AuthContext> peer = context.auth_context();
    // All ports of the server use TLS: a call without it comes from inside the process.
    if (peer == nullptr || peer->FindPropertyValues(GRPC_TRANSPORT_SECURITY_TYPE_PROPERTY_NAME).empty())
      return OfInside(context);
    return IdentityOf(*known_, *peer, context.client_metadata(), wall_now_());
  }

 private:
  absl::StatusOr<Identity> OfInside(const grpc::CallbackServerContext& context) const {
    const auto credential = context.client_metadata().find(kInNameOfKey);
    if (credential == context.client_metadata().end()) return LocalIdentity();
    const absl::string_view id = View(credential->second);
    const absl::StatusOr<Credential> found = known_->OfValidId({id.data(), id.size()}, wall_now_());
    if (!found.ok()) return found.status();
    return found->identity();
  }

  const KnownCredentials* const known_;
  const std::function<absl::Time()> wall_now_;
};

class LocalCallers final : public Callers {
 public:
  absl::StatusOr<Identity> Of(const grpc::CallbackServerContext&) const override { return LocalIdentity(); }
};

}  // namespace

std::shared_ptr<grpc::AuthMetadataProcessor> MakeCallerCheck(const KnownCredentials* known,
                                                             const Authoriser* authoriser,
                                                             std::function<absl::Time()> wall_now,
                                                             RefusalListener on_refusal) {
  return std::make_shared<CallerCheck>(known, authoriser, std::move(wall_now), std::move(on_refusal));
}

std::unique_ptr<Callers> MakeCallers(const KnownCredentials* known, std::function<absl::Time()> wall_now) {
  return std::make_unique<CheckedCallers>(known, std::move(wall_now));
}

std::unique_ptr<Callers> MakeLocalCallers() { return std::make_unique<LocalCallers>(); }

}  // namespace lumifold::access
