#include "server/access/access_store.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <optional>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "filter/image/file_calls.h"
#include "server/ledger/open_job_store.h"
#include "server/ledger/postgres_connection.h"
#include "server/ledger/sqlite_connection.h"

namespace lumifold::access {
namespace {

using ledger::SqlBytes;
using ledger::SqlConnection;
using ledger::SqlRow;

constexpr int64_t kSchemaVersion = 1;
/// Rows are kept this long after they expire, for those who ask who had access.
constexpr absl::Duration kKeepExpired = absl::Hours(24 * 365);

constexpr char kSchema[] = R"(
CREATE TABLE IF NOT EXISTS access_state(schema_version BIGINT NOT NULL, changes BIGINT NOT NULL);
CREATE TABLE IF NOT EXISTS access_credentials(
  number {serial},
  id TEXT NOT NULL UNIQUE,
  form BIGINT NOT NULL,
  kind BIGINT NOT NULL,
  name TEXT NOT NULL,
  scopes BIGINT NOT NULL,
  sha256 {blob} NOT NULL UNIQUE,
  token_lifetime_ms BIGINT NOT NULL,
  created_ms BIGINT NOT NULL,
  expires_ms BIGINT NOT NULL,
  ended BIGINT NOT NULL);
)";

// In the order of ReadCredential.
constexpr char kColumns[] =
    "number, id, form, kind, name, scopes, token_lifetime_ms, created_ms, expires_ms, ended, sha256";

int64_t BitsOf(const std::set<Scope>& scopes) {
  int64_t bits = 0;
  for (const Scope scope : scopes) bits |= int64_t{1} << static_cast<int>(scope);
  return bits;
}

std::set<Scope> ScopesOf(int64_t bits) {
  std::set<Scope> scopes;
  for (const Scope scope : {Scope::kRead, Scope::kSubmit, Scope::kAdmin}) {
    if ((bits & BitsOf({scope})) != 0) scopes.insert(scope);
  }
  return scopes;
}

int64_t Milliseconds(absl::Time time) { return absl::ToUnixMillis(time); }

struct Row {
  int64_t number = 0;
  NewCredential row;
};

Row ReadCredential(SqlRow& row) {
  Row read;
  read.number = row.Int();
  Credential& credential = read.row.credential;
  credential.id = row.Text();
  credential.form = static_cast<CredentialForm>(row.Int());
  credential.kind = static_cast<IdentityKind>(row.Int());
  credential.name = row.Text();
  credential.scopes = ScopesOf(row.Int());
  credential.token_lifetime = absl::Milliseconds(row.Int());
  credential.created = absl::FromUnixMillis(row.Int());
  credential.expires = absl::FromUnixMillis(row.Int());
  credential.end = static_cast<Credential::End>(row.Int());
  read.row.sha256 = row.Bytes();
  return read;
}

absl::Status CreateTables(SqlConnection& db) {
  // In a transaction this takes the lock of the schema: two coordinators may start at the same time.
  if (const absl::StatusOr<int64_t> version = db.SchemaVersion(); !version.ok()) return version.status();
  absl::Status status = db.RunScript(
      absl::StrReplaceAll(kSchema, {{"{serial}", db.dialect().serial}, {"{blob}", db.dialect().blob}}));
  if (!status.ok()) return status;
  const absl::StatusOr<std::optional<int64_t>> version =
      db.QueryInt("SELECT schema_version FROM access_state", {});
  if (!version.ok()) return version.status();
  if (!version->has_value())
    return db.Run("INSERT INTO access_state(schema_version, changes) VALUES($1, $2)",
                  {kSchemaVersion, int64_t{0}});
  if (**version == kSchemaVersion) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("access store: written by another version of Lumifold (schema ", **version, ", expected ",
                   kSchemaVersion, ")"));
}

absl::StatusOr<std::unique_ptr<SqlConnection>> OpenSqlite(const std::string& path) {
  // SQLite would create it with the rights of the umask. Its log and its shared memory get the rights of the
  // database.
  const int file = open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0600);
  if (file < 0) return StorageError(path, errno);
  close(file);
  absl::StatusOr<std::unique_ptr<ledger::SqliteConnection>> db = ledger::SqliteConnection::Open(path);
  if (!db.ok()) return db.status();
  return *std::move(db);
}

absl::StatusOr<std::unique_ptr<SqlConnection>> OpenDatabase(const std::string& name,
                                                            const std::string& sqlite_path) {
  if (name.empty() || name == ledger::kSqliteStore) return OpenSqlite(sqlite_path);
  if (!absl::StartsWith(name, "postgresql://") && !absl::StartsWith(name, "postgres://"))
    return absl::InvalidArgumentError("store: neither \"sqlite\" nor a URI that begins with postgresql://");
  absl::StatusOr<std::unique_ptr<ledger::PostgresConnection>> db = ledger::PostgresConnection::Open(name);
  if (!db.ok()) return db.status();
  return *std::move(db);
}

}  // namespace

absl::StatusOr<std::unique_ptr<AccessStore>> AccessStore::Open(const std::string& name,
                                                               const std::string& sqlite_path) {
  absl::StatusOr<std::unique_ptr<SqlConnection>> db = OpenDatabase(name, sqlite_path);
  if (!db.ok()) return db.status();
  SqlConnection& connection = **db;
  if (absl::Status status = connection.InTransaction([&connection] { return CreateTables(connection); });
      !status.ok())
    return status;
  return std::unique_ptr<AccessStore>(new AccessStore(*std::move(db)));
}

absl::Status AccessStore::CountChange() {
  return db_->Run("UPDATE access_state SET changes = changes + 1", {});
}

absl::Status AccessStore::Insert(const NewCredential& added) {
  const Credential& credential = added.credential;
  absl::Status status = db_->Run("DELETE FROM access_credentials WHERE expires_ms < $1",
                                 {Milliseconds(credential.created - kKeepExpired)});
  if (!status.ok()) return status;
  status = db_->Run(
      "INSERT INTO access_credentials(id, form, kind, name, scopes, sha256, token_lifetime_ms, created_ms, "
      "expires_ms,"
      " ended) VALUES($1, $2, $3, $4, $5, $6, $7, $8, $9, $10)",
      {std::string_view(credential.id), static_cast<int64_t>(credential.form),
       static_cast<int64_t>(credential.kind), std::string_view(credential.name), BitsOf(credential.scopes),
       SqlBytes{added.sha256}, absl::ToInt64Milliseconds(credential.token_lifetime),
       Milliseconds(credential.created), Milliseconds(credential.expires),
       static_cast<int64_t>(credential.end)});
  return status.ok() ? CountChange() : status;
}

absl::Status AccessStore::Add(const NewCredential& credential) {
  return db_->InTransaction([&] { return Insert(credential); });
}

absl::Status AccessStore::AddFor(const std::string& id, const NewCredential& credential) {
  return db_->InTransaction([&] {
    const absl::StatusOr<std::optional<int64_t>> number = db_->QueryInt(
        absl::StrCat("SELECT number FROM access_credentials WHERE id = $1 AND ended = 0 AND expires_ms > $2",
                     db_->dialect().for_update),
        {std::string_view(id), Milliseconds(credential.credential.created)});
    if (!number.ok()) return number.status();
    return number->has_value() ? Insert(credential)
                               : absl::UnauthenticatedError("the certificate is not valid any more");
  });
}

absl::Status AccessStore::Exchange(const std::string& invite_sha256, IdentityKind kind, absl::Time now,
                                   absl::FunctionRef<absl::StatusOr<NewCredential>(const Credential&)> make) {
  return db_->InTransaction([&] {
    std::optional<Credential> invite;
    absl::Status status = db_->Query(
        absl::StrCat("SELECT ", kColumns, " FROM access_credentials WHERE sha256 = $1",
                     db_->dialect().for_update),
        {SqlBytes{invite_sha256}}, [&invite](SqlRow& row) { invite = ReadCredential(row).row.credential; });
    if (!status.ok()) return status;
    // One answer for all reasons: whoever guesses learns nothing.
    if (!invite.has_value() || invite->form != CredentialForm::kInvite || invite->kind != kind ||
        !invite->IsValid(now))
      return absl::UnauthenticatedError(
          "the code is not valid: it may have been used, have expired or be of another kind");
    const absl::StatusOr<NewCredential> made = make(*invite);
    if (!made.ok()) return made.status();
    status = db_->Run("UPDATE access_credentials SET ended = $1 WHERE id = $2",
                      {static_cast<int64_t>(Credential::End::kUsed), std::string_view(invite->id)});
    return status.ok() ? Insert(*made) : status;
  });
}

absl::StatusOr<int> AccessStore::Revoke(const std::string& id, const std::string& name, absl::Time now) {
  const std::string column = id.empty() ? "name" : "id";
  const std::string_view value = id.empty() ? name : id;
  int64_t valid = 0;
  absl::Status status = db_->InTransaction([&] {
    const absl::StatusOr<std::optional<int64_t>> known = db_->QueryInt(
        absl::StrCat("SELECT COUNT(*) FROM access_credentials WHERE ", column, " = $1"), {value});
    if (!known.ok()) return known.status();
    if (known->value_or(0) == 0)
      return absl::NotFoundError(absl::StrCat("there is no identity with this ", column));
    const std::string those = absl::StrCat(" WHERE ", column, " = $1 AND ended = 0 AND expires_ms > $2");
    const absl::StatusOr<std::optional<int64_t>> count = db_->QueryInt(
        absl::StrCat("SELECT COUNT(*) FROM access_credentials", those), {value, Milliseconds(now)});
    if (!count.ok()) return count.status();
    valid = count->value_or(0);
    absl::Status updated = db_->Run(absl::StrCat("UPDATE access_credentials SET ended = ",
                                                 static_cast<int>(Credential::End::kRevoked), those),
                                    {value, Milliseconds(now)});
    return updated.ok() ? CountChange() : updated;
  });
  if (!status.ok()) return status;
  return static_cast<int>(valid);
}

absl::StatusOr<std::vector<AccessStore::Numbered>> AccessStore::List(int64_t before, int limit,
                                                                     bool valid_only, absl::Time now) {
  std::vector<Numbered> found;
  absl::Status status = db_->Query(
      absl::StrCat("SELECT ", kColumns,
                   " FROM access_credentials WHERE number < $1 AND expires_ms > $2 AND ended <= $3",
                   " ORDER BY number DESC LIMIT $4"),
      {before == 0 ? INT64_MAX : before, valid_only ? Milliseconds(now) : int64_t{0},
       static_cast<int64_t>(valid_only ? Credential::End::kNone : Credential::End::kUsed), int64_t{limit}},
      [&found](SqlRow& row) {
        Row read = ReadCredential(row);
        found.emplace_back(read.number, std::move(read.row.credential));
      });
  if (!status.ok()) return status;
  return found;
}

absl::StatusOr<int64_t> AccessStore::Version() {
  const absl::StatusOr<std::optional<int64_t>> changes =
      db_->QueryInt("SELECT changes FROM access_state", {});
  if (!changes.ok()) return changes.status();
  return changes->value_or(0);
}

absl::StatusOr<std::vector<NewCredential>> AccessStore::Identities(absl::Time now) {
  std::vector<NewCredential> found;
  absl::Status status = db_->Query(
      absl::StrCat("SELECT ", kColumns, " FROM access_credentials WHERE form <> $1 AND expires_ms > $2"),
      {static_cast<int64_t>(CredentialForm::kInvite), Milliseconds(now)},
      [&found](SqlRow& row) { found.push_back(ReadCredential(row).row); });
  if (!status.ok()) return status;
  return found;
}

}  // namespace lumifold::access
