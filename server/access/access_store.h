#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/access/credential.h"
#include "server/ledger/sql_connection.h"

namespace lumifold::access {

/// A new credential, and the SHA-256 of its secret, or of a certificate.
struct NewCredential {
  Credential credential;
  std::string sha256;
};

/// Invites, tokens and certificates, in SQLite or PostgreSQL. Several coordinators may use one at the same
/// time.
/// Errors of all calls: those of ledger::SqlConnection. None has a secret.
/// Threads: one at a time.
class AccessStore {
 public:
  /// Opens the store of a name as ledger::OpenJobStore does: empty or "sqlite" for the file `sqlite_path`,
  /// which only the user can read, or a URI "postgresql://...". Creates its tables.
  static absl::StatusOr<std::unique_ptr<AccessStore>> Open(const std::string& name,
                                                           const std::string& sqlite_path);

  absl::Status Add(const NewCredential& credential);

  /// The same on behalf of `id`, in one transaction.
  /// Errors: kUnauthenticated where that is not valid any more.
  absl::Status AddFor(const std::string& id, const NewCredential& credential);

  /// Exchanges an invite, once: `make` gets it and returns what takes its place. Both happen or neither.
  /// Errors: kUnauthenticated where no valid invite for this kind has the hash, without saying why; those of
  /// `make`.
  absl::Status Exchange(const std::string& invite_sha256, IdentityKind kind, absl::Time now,
                        absl::FunctionRef<absl::StatusOr<NewCredential>(const Credential& invite)> make);

  /// Revokes what has this id, or, with an empty id, all with this name. Returns how many were valid until
  /// now.
  /// Errors: kNotFound where there is none, valid or not.
  absl::StatusOr<int> Revoke(const std::string& id, const std::string& name, absl::Time now);

  /// Credentials by descending number, from below `before` on (0: from the newest), at most `limit`, each
  /// with its number.
  using Numbered = std::pair<int64_t, Credential>;
  absl::StatusOr<std::vector<Numbered>> List(int64_t before, int limit, bool valid_only, absl::Time now);

  /// Rises with each change, whoever makes it.
  absl::StatusOr<int64_t> Version();
  /// All tokens and certificates that have not expired, revoked ones included.
  absl::StatusOr<std::vector<NewCredential>> Identities(absl::Time now);

 private:
  explicit AccessStore(std::unique_ptr<ledger::SqlConnection> db) : db_(std::move(db)) {}
  absl::Status Insert(const NewCredential& credential);
  absl::Status CountChange();

  const std::unique_ptr<ledger::SqlConnection> db_;
};

}  // namespace lumifold::access
