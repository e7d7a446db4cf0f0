// The calls of AccessService.

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "proto/identity/secrets.h"
#include "proto/logging/fields.h"
#include "server/access/access_control.h"

namespace lumifold::access {
namespace {

constexpr int64_t kMaxTokenLifetimeSeconds = int64_t{365} * 24 * 3600;
constexpr int kMaxScopes = 8;
constexpr int kDefaultPage = 100;
constexpr int kMaxPage = 1000;
constexpr size_t kIdBytes = 8;

absl::Status BadField(const char* field, const char* why) {
  return absl::InvalidArgumentError(absl::StrCat(field, ": ", why));
}

absl::Status CheckCode(const std::string& code) {
  return !code.empty() && code.size() <= identity::kMaxSecretTextBytes
             ? absl::OkStatus()
             : BadField("code", "is empty or too long");
}

absl::StatusOr<std::set<Scope>> ScopesFrom(const google::protobuf::RepeatedField<int>& values) {
  if (values.size() > kMaxScopes) return BadField("scopes", "too many");
  std::set<Scope> scopes;
  for (const int value : values) {
    if (value < v1::ACCESS_SCOPE_READ || value > v1::ACCESS_SCOPE_ADMIN)
      return BadField("scopes", "unknown scope");
    scopes.insert(static_cast<Scope>(value - v1::ACCESS_SCOPE_READ));
  }
  return scopes;
}

template <typename Message>
void AddScopes(const std::set<Scope>& scopes, Message* message) {
  for (const Scope scope : scopes)
    message->add_scopes(static_cast<v1::AccessScope>(static_cast<int>(scope) + v1::ACCESS_SCOPE_READ));
}

v1::HolderKind HolderOf(IdentityKind kind) {
  switch (kind) {
    case IdentityKind::kLocal:
      return v1::HOLDER_KIND_LOCAL;
    case IdentityKind::kPerson:
      return v1::HOLDER_KIND_PERSON;
    case IdentityKind::kWorker:
      return v1::HOLDER_KIND_WORKER;
  }
  return v1::HOLDER_KIND_UNSPECIFIED;
}

v1::CredentialState StateOf(const Credential& credential, absl::Time now) {
  if (credential.end == Credential::End::kUsed) return v1::CREDENTIAL_STATE_USED;
  if (credential.end == Credential::End::kRevoked) return v1::CREDENTIAL_STATE_REVOKED;
  return now < credential.expires ? v1::CREDENTIAL_STATE_VALID : v1::CREDENTIAL_STATE_EXPIRED;
}

void FillCredential(const Credential& credential, absl::Time now, v1::Credential* message) {
  message->set_id(credential.id);
  message->set_form(static_cast<v1::CredentialForm>(credential.form));
  message->set_kind(HolderOf(credential.kind));
  message->set_name(credential.name);
  AddScopes(credential.scopes, message);
  message->set_state(StateOf(credential, now));
  message->set_created_unix_ms(absl::ToUnixMillis(credential.created));
  message->set_expires_unix_ms(absl::ToUnixMillis(credential.expires));
}

absl::StatusOr<std::string> NewId() {
  const absl::StatusOr<std::string> bytes = identity::RandomBytes(kIdBytes);
  if (!bytes.ok()) return bytes.status();
  return absl::BytesToHexString(*bytes);
}

/// The invite of a request, all but its id and times.
absl::StatusOr<Credential> InviteFrom(const v1::CreateInviteRequest& request) {
  Credential invite;
  invite.name = request.name();
  if (absl::Status status = CheckCredentialName(request.name()); !status.ok()) return status;
  absl::StatusOr<std::set<Scope>> scopes = ScopesFrom(request.scopes());
  if (!scopes.ok()) return scopes.status();
  invite.scopes = *std::move(scopes);
  const int64_t seconds = request.token_lifetime_seconds();
  if (seconds < 0 || seconds > kMaxTokenLifetimeSeconds)
    return BadField("token_lifetime_seconds", "must be 0 to 31536000");
  if (request.kind() == v1::HOLDER_KIND_PERSON) {
    if (invite.scopes.empty()) return BadField("scopes", "a person needs at least one");
    invite.token_lifetime = absl::Seconds(seconds);
    return invite;
  }
  if (request.kind() != v1::HOLDER_KIND_WORKER) return BadField("kind", "must be person or worker");
  if (!invite.scopes.empty()) return BadField("scopes", "a worker has none");
  if (seconds != 0) return BadField("token_lifetime_seconds", "a worker has no token");
  invite.kind = IdentityKind::kWorker;
  return invite;
}

struct NewToken {
  NewCredential credential;
  std::string token;
};
absl::StatusOr<NewToken> MakeTokenFor(const Credential& invite, absl::Time now) {
  absl::StatusOr<std::string> token = identity::MakeToken();
  absl::StatusOr<std::string> id = NewId();
  if (!token.ok()) return token.status();
  if (!id.ok()) return id.status();
  const bool is_usual = invite.token_lifetime == absl::ZeroDuration();
  NewCredential made;
  made.sha256 = identity::HashOf(*token);
  made.credential.id = *std::move(id);
  made.credential.form = CredentialForm::kToken;
  made.credential.name = invite.name;
  made.credential.scopes = invite.scopes;
  made.credential.created = now;
  made.credential.expires = now + (is_usual ? kCredentialLifetime : invite.token_lifetime);
  return NewToken{.credential = std::move(made), .token = *std::move(token)};
}

}  // namespace

absl::StatusOr<AccessControl::SignedKey> AccessControl::SignKey(const Credential& holder,
                                                                const std::string& request_pem) const {
  const absl::Time now = options_.wall_now();
  const absl::Duration lifetime = holder.token_lifetime == absl::ZeroDuration()
                                      ? options_.certificate_lifetime
                                      : std::min(options_.certificate_lifetime, holder.token_lifetime);
  absl::StatusOr<CertificateAuthority::ClientCertificate> made =
      authority_->SignClient(holder.kind, holder.name, request_pem, now, lifetime);
  if (!made.ok()) return made.status();
  return SignedKey{.credential = {.credential = {.id = made->serial,
                                                 .form = CredentialForm::kCertificate,
                                                 .kind = holder.kind,
                                                 .name = holder.name,
                                                 .scopes = holder.scopes,
                                                 .token_lifetime = holder.token_lifetime,
                                                 .created = now,
                                                 .expires = made->expires},
                                  .sha256 = made->sha256},
                   .pem = std::move(made->pem)};
}

v1::CertificateResponse AccessControl::ResponseFor(const SignedKey& made) const {
  v1::CertificateResponse response;
  response.set_name(made.credential.credential.name);
  response.set_certificate_pem(made.pem);
  response.set_ca_pem(authority_->pem());
  response.set_expires_unix_ms(absl::ToUnixMillis(made.credential.credential.expires));
  return response;
}

absl::StatusOr<v1::CertificateResponse> AccessControl::Enroll(const v1::EnrollRequest& request) {
  if (absl::Status status = CheckCode(request.code()); !status.ok()) return status;
  absl::StatusOr<SignedKey> made = absl::InternalError("no certificate was made");
  absl::MutexLock lock(&mutex_);
  absl::Status status =
      store_->Exchange(identity::HashOf(request.code()), IdentityKind::kWorker, options_.wall_now(),
                       [&](const Credential& invite) -> absl::StatusOr<NewCredential> {
                         made = SignKey(invite, request.certificate_request_pem());
                         if (!made.ok()) return made.status();
                         return made->credential;
                       });
  if (!status.ok()) return status;
  known_.Add(made->credential);
  options_.log->info("event=worker_enrolled name={} serial={}", made->credential.credential.name,
                     made->credential.credential.id);
  return ResponseFor(*made);
}

absl::StatusOr<v1::LoginResponse> AccessControl::Login(const v1::LoginRequest& request) {
  if (absl::Status status = CheckCode(request.code()); !status.ok()) return status;
  const absl::Time now = options_.wall_now();
  const bool wants_certificate = !request.certificate_request_pem().empty();
  v1::LoginResponse response;
  NewCredential made;
  absl::MutexLock lock(&mutex_);
  absl::Status status = store_->Exchange(identity::HashOf(request.code()), IdentityKind::kPerson, now,
                                         [&](const Credential& invite) -> absl::StatusOr<NewCredential> {
                                           if (wants_certificate) {
                                             absl::StatusOr<SignedKey> key =
                                                 SignKey(invite, request.certificate_request_pem());
                                             if (!key.ok()) return key.status();
                                             response.set_certificate_pem(std::move(key->pem));
                                             made = std::move(key->credential);
                                           } else {
                                             absl::StatusOr<NewToken> token = MakeTokenFor(invite, now);
                                             if (!token.ok()) return token.status();
                                             response.set_token(std::move(token->token));
                                             made = std::move(token->credential);
                                           }
                                           return made;
                                         });
  if (!status.ok()) return status;
  known_.Add(made);
  options_.log->info("event=person_logged_in name={} form={} id={}", made.credential.name,
                     wants_certificate ? "certificate" : "token", made.credential.id);
  response.set_name(made.credential.name);
  AddScopes(made.credential.scopes, &response);
  response.set_expires_unix_ms(absl::ToUnixMillis(made.credential.expires));
  return response;
}

absl::StatusOr<v1::CertificateResponse> AccessControl::RenewCertificate(
    const Identity& caller, const v1::RenewCertificateRequest& request) {
  absl::StatusOr<Credential> holder = known_.OfId(caller.id);
  if (!holder.ok() || holder->form != CredentialForm::kCertificate)
    return absl::FailedPreconditionError("the caller has no certificate, and only those are renewed");
  if (holder->token_lifetime != absl::ZeroDuration()) {
    const absl::Time end = holder->created + holder->token_lifetime;
    // Certificates have whole seconds.
    if (holder->expires + absl::Seconds(1) >= end)
      return absl::FailedPreconditionError(
          "the time that the caller was invited for ends with its certificate");
    holder->token_lifetime = end - options_.wall_now();
  }
  const absl::StatusOr<SignedKey> made = SignKey(*holder, request.certificate_request_pem());
  if (!made.ok()) return made.status();
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = store_->AddFor(caller.id, made->credential); !status.ok()) return status;
  known_.Add(made->credential);
  options_.log->info("event={}_certificate_renewed name={} serial={} before={}",
                     caller.kind == IdentityKind::kWorker ? "worker" : "person", caller.name,
                     made->credential.credential.id, caller.id);
  return ResponseFor(*made);
}

v1::WhoAmIResponse DescribeCaller(const AccessControl* access, const Identity& caller) {
  v1::WhoAmIResponse response;
  response.set_kind(HolderOf(caller.kind));
  response.set_name(caller.name);
  AddScopes(caller.scopes, &response);
  response.set_id(caller.id);
  if (access == nullptr) return response;
  if (const absl::StatusOr<Credential> known = access->known().OfId(caller.id); known.ok())
    response.set_expires_unix_ms(absl::ToUnixMillis(known->expires));
  return response;
}

absl::StatusOr<v1::CreateInviteResponse> AccessControl::CreateInvite(const Identity& caller,
                                                                     const v1::CreateInviteRequest& request) {
  absl::StatusOr<Credential> invite = InviteFrom(request);
  if (!invite.ok()) return invite.status();
  const absl::StatusOr<std::string> secret = identity::RandomBytes(identity::kCodeSecretBytes);
  const absl::StatusOr<std::string> id = NewId();
  if (!secret.ok()) return secret.status();
  if (!id.ok()) return id.status();
  invite->id = *id;
  invite->created = options_.wall_now();
  invite->expires = invite->created + kInviteLifetime;
  {
    absl::MutexLock lock(&mutex_);
    absl::Status status =
        store_->Add({.credential = *invite, .sha256 = identity::HashOf(identity::SecretText(*secret))});
    if (!status.ok()) return status;
  }
  options_.log->info("event=invite_created by={} kind={} name={} id={}", caller.name,
                     invite->kind == IdentityKind::kWorker ? "worker" : "person", invite->name, *id);
  v1::CreateInviteResponse response;
  response.set_code(identity::TextOfCode({.ca_sha256 = authority_->sha256(), .secret = *secret}));
  response.set_id(*id);
  response.set_expires_unix_ms(absl::ToUnixMillis(invite->expires));
  return response;
}

absl::StatusOr<v1::ListIdentitiesResponse> AccessControl::ListIdentities(
    const v1::ListIdentitiesRequest& request) {
  if (request.limit() < 0 || request.limit() > kMaxPage) return BadField("limit", "must be 0 to 1000");
  int64_t before = 0;
  if (!request.page_token().empty() && (!absl::SimpleAtoi(request.page_token(), &before) || before <= 0))
    return BadField("page_token", "is not one of this call's");
  const int limit = request.limit() == 0 ? kDefaultPage : request.limit();
  const absl::Time now = options_.wall_now();
  absl::MutexLock lock(&mutex_);
  // One more than the page says whether there is another.
  const absl::StatusOr<std::vector<AccessStore::Numbered>> found =
      store_->List(before, limit + 1, request.valid_only(), now);
  if (!found.ok()) return found.status();
  v1::ListIdentitiesResponse response;
  for (const auto& [number, credential] : *found) {
    if (response.credentials_size() == limit) {
      response.set_next_page_token(absl::StrCat((*found)[static_cast<size_t>(limit) - 1].first));
      break;
    }
    FillCredential(credential, now, response.add_credentials());
  }
  return response;
}

absl::StatusOr<v1::RevokeResponse> AccessControl::Revoke(const Identity& caller,
                                                         const v1::RevokeRequest& request) {
  if (request.id().empty() == request.name().empty())
    return absl::InvalidArgumentError("exactly one of id and name must be given");
  if (request.id().size() > kMaxIdBytes) return BadField("id", "is too long");
  if (!request.name().empty()) {
    if (absl::Status status = CheckCredentialName(request.name()); !status.ok()) return status;
  }
  absl::StatusOr<int> revoked;
  {
    absl::MutexLock lock(&mutex_);
    revoked = store_->Revoke(request.id(), request.name(), options_.wall_now());
  }
  if (!revoked.ok()) return revoked.status();
  options_.log->info("event=revoked by={} id={} name={} count={}", caller.name, logging::Quoted(request.id()),
                     logging::Quoted(request.name()), *revoked);
  Refresh();  // at once, not at the next interval
  v1::RevokeResponse response;
  response.set_revoked(*revoked);
  return response;
}

}  // namespace lumifold::access
