#include "server/access/known_credentials.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/identity/secrets.h"

namespace lumifold::access {
namespace {

absl::Status CheckIsValid(const Credential& credential, absl::Time now) {
  const bool is_certificate = credential.form == CredentialForm::kCertificate;
  const char* what = is_certificate ? "the certificate" : "the token";
  if (credential.end != Credential::End::kNone)
    return absl::UnauthenticatedError(absl::StrCat(what, " of ", credential.name, " was revoked"));
  if (now < credential.expires) return absl::OkStatus();
  std::string message = absl::StrCat(what, " of ", credential.name, " has expired");
  return is_certificate ? absl::UnavailableError(message) : absl::UnauthenticatedError(message);
}

}  // namespace

void KnownCredentials::Replace(std::vector<NewCredential> credentials) {
  std::map<std::string, Credential, std::less<>> by_id;
  std::map<std::string, std::string, std::less<>> id_of_token;
  for (NewCredential& added : credentials) {
    if (added.credential.form == CredentialForm::kToken)
      id_of_token.emplace(std::move(added.sha256), added.credential.id);
    by_id.emplace(added.credential.id, std::move(added.credential));
  }
  absl::MutexLock lock(&mutex_);
  by_id_.swap(by_id);
  id_of_token_.swap(id_of_token);
}

void KnownCredentials::Add(const NewCredential& added) {
  absl::MutexLock lock(&mutex_);
  if (added.credential.form == CredentialForm::kToken)
    id_of_token_.emplace(added.sha256, added.credential.id);
  by_id_.emplace(added.credential.id, added.credential);
}

absl::StatusOr<Credential> KnownCredentials::OfToken(std::string_view token, absl::Time now) const {
  if (token.size() > identity::kMaxSecretTextBytes)
    return absl::UnauthenticatedError("the token is not valid");
  const std::string sha256 = identity::HashOf(token);
  absl::MutexLock lock(&mutex_);
  // The search compares hashes, of which an attacker cannot choose the bytes: how long it takes tells
  // nothing.
  const auto id = id_of_token_.find(sha256);
  if (id == id_of_token_.end()) return absl::UnauthenticatedError("the token is not valid");
  const Credential& found = by_id_.at(id->second);
  if (absl::Status status = CheckIsValid(found, now); !status.ok()) return status;
  return found;
}

absl::StatusOr<Credential> KnownCredentials::OfCertificate(std::string_view serial, absl::Time now) const {
  absl::MutexLock lock(&mutex_);
  const auto found = by_id_.find(serial);
  if (found == by_id_.end() || found->second.form != CredentialForm::kCertificate)
    return absl::UnauthenticatedError("the certificate is not one of this coordinator's");
  if (absl::Status status = CheckIsValid(found->second, now); !status.ok()) return status;
  return found->second;
}

absl::StatusOr<Credential> KnownCredentials::OfSeal(std::string_view seal, absl::Time now) const {
  const absl::StatusOr<std::string> id = seal_.Open({seal.data(), seal.size()}, now);
  if (!id.ok()) return id.status();
  return OfValidId(*id, now);
}

absl::StatusOr<Credential> KnownCredentials::OfValidId(std::string_view id, absl::Time now) const {
  absl::StatusOr<Credential> found = OfId(id);
  if (!found.ok()) return absl::UnauthenticatedError("the caller's token or certificate is not known here");
  if (absl::Status status = CheckIsValid(*found, now); !status.ok()) return status;
  return found;
}

absl::StatusOr<Credential> KnownCredentials::OfId(std::string_view id) const {
  absl::MutexLock lock(&mutex_);
  const auto found = by_id_.find(id);
  if (found == by_id_.end()) return absl::NotFoundError("no such identity");
  return found->second;
}

absl::Status KnownCredentials::Check(const Identity& identity, absl::Time now) const {
  if (identity.kind == IdentityKind::kLocal) return absl::OkStatus();
  absl::MutexLock lock(&mutex_);
  const auto found = by_id_.find(identity.id);
  if (found != by_id_.end()) return CheckIsValid(found->second, now);
  // Rows of credentials that expired long ago are not read again.
  const absl::Status expired = absl::UnauthenticatedError("the identity is no longer known");
  return identity.kind == IdentityKind::kWorker ? absl::UnavailableError(expired.message()) : expired;
}

}  // namespace lumifold::access
