#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/access/access_store.h"
#include "server/access/credential.h"
#include "server/access/forward_seal.h"

namespace lumifold::access {

/// The tokens and certificates of the access store in memory: a call is checked without the database, which
/// an attacker's guesses never reach.
/// Errors of all calls: kUnauthenticated for what is unknown or revoked; kUnavailable for a certificate that
/// has expired, as its owner has a newer one and need only connect again.
/// Threads: safe.
class KnownCredentials {
 public:
  /// With the secret of the coordinators of this authority.
  explicit KnownCredentials(std::string forward_secret = "") : seal_(std::move(forward_secret)) {}

  void Replace(std::vector<NewCredential> credentials);
  /// One that was just made, which the next Replace has too.
  void Add(const NewCredential& credential);

  absl::StatusOr<Credential> OfToken(std::string_view token, absl::Time now) const;
  /// `serial`: of a certificate that the handshake has verified.
  absl::StatusOr<Credential> OfCertificate(std::string_view serial, absl::Time now) const;
  /// The credential that a call was forwarded for, see ForwardSeal.
  absl::StatusOr<Credential> OfSeal(std::string_view seal, absl::Time now) const;
  /// The credential of an Identity::id.
  absl::StatusOr<Credential> OfValidId(std::string_view id, absl::Time now) const;
  const ForwardSeal& seal() const { return seal_; }
  /// Errors: kNotFound.
  absl::StatusOr<Credential> OfId(std::string_view id) const;
  /// Whether an identity that was valid still is. The local one always is.
  absl::Status Check(const Identity& identity, absl::Time now) const;

 private:
  const ForwardSeal seal_;
  mutable absl::Mutex mutex_;
  std::map<std::string, Credential, std::less<>> by_id_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, std::string, std::less<>> id_of_token_ ABSL_GUARDED_BY(mutex_);  // by SHA-256
};

}  // namespace lumifold::access
