#pragma once

#include <cstddef>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/access/identity.h"

namespace lumifold::access {

inline constexpr size_t kMaxNameBytes = 64;
inline constexpr size_t kMaxIdBytes = 64;

/// What gives an identity, or, of an invite, may be exchanged for one.
enum class CredentialForm { kInvite = 1, kToken = 2, kCertificate = 3 };

/// A row of the access store. What is secret of it is not here: the store has its SHA-256 only.
struct Credential {
  std::string id;  // 16 hexadecimal digits; of a certificate its serial number, 32 digits
  CredentialForm form = CredentialForm::kInvite;
  IdentityKind kind = IdentityKind::kPerson;
  std::string name;
  std::set<Scope> scopes;
  /// Of an invite for a person: lifetime of the token, or of all certificates; of a person's certificate:
  /// what was left of that when it was made. Zero: the usual lifetime of a token, and certificates without
  /// end.
  absl::Duration token_lifetime;
  absl::Time created;
  absl::Time expires;
  enum class End { kNone = 0, kRevoked = 1, kUsed = 2 };
  End end = End::kNone;

  bool IsValid(absl::Time now) const { return end == End::kNone && now < expires; }
  Identity identity() const { return {.kind = kind, .name = name, .scopes = scopes, .id = id}; }
};

/// 1 to 64 letters, digits and ". _ - @ :", a letter or digit first: a name is part of certificates, files
/// and logs.
/// Errors: kInvalidArgument.
absl::Status CheckCredentialName(const std::string& name);

}  // namespace lumifold::access
