#include "server/ledger/sql_schema.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "server/job/limits.h"
#include "server/ledger/sql_jobs.h"

namespace lumifold::ledger {
namespace {

constexpr int64_t kSchemaVersion = 7;

// Times are milliseconds since 1970; 0 means "not yet". A film is what is rendered of a frame: a frame that
// is rendered again has a new film, and the units of the old one are garbage. The key of units has the order
// in which a film is assembled. jobs.files, which may have megabytes, is the last column, so that lists need
// not read past it.
constexpr char kSchema[] = R"(
CREATE TABLE epochs(last BIGINT NOT NULL);
INSERT INTO epochs(last) VALUES(0);
CREATE TABLE jobs(
  number {serial},
  id TEXT NOT NULL UNIQUE,
  request_id TEXT NOT NULL UNIQUE,
  request_digest {blob} NOT NULL,
  owner TEXT NOT NULL,
  epoch BIGINT NOT NULL,
  state BIGINT NOT NULL,
  user_name TEXT NOT NULL,
  error TEXT NOT NULL DEFAULT '',
  numeric_class TEXT NOT NULL DEFAULT '',
  submitted_ms BIGINT NOT NULL,
  started_ms BIGINT NOT NULL DEFAULT 0,
  units_done BIGINT NOT NULL DEFAULT 0,
  samples_done BIGINT NOT NULL DEFAULT 0,
  bad_samples BIGINT NOT NULL DEFAULT 0,
  frames_done BIGINT NOT NULL DEFAULT 0,
  render_seconds DOUBLE PRECISION NOT NULL DEFAULT 0,
  assemble_seconds DOUBLE PRECISION NOT NULL DEFAULT 0,
  filter_seconds DOUBLE PRECISION NOT NULL DEFAULT 0,
  write_seconds DOUBLE PRECISION NOT NULL DEFAULT 0,
  warnings_left_out BIGINT NOT NULL DEFAULT 0,
  estimated_error DOUBLE PRECISION NOT NULL DEFAULT {no_error},
  counted BIGINT NOT NULL DEFAULT 0,
  scheduling {blob} NOT NULL,
  spec {blob} NOT NULL,
  files {blob} NOT NULL);
CREATE INDEX jobs_by_state ON jobs(state, number);
CREATE INDEX jobs_by_user ON jobs(user_name, number);
CREATE INDEX jobs_by_user_and_state ON jobs(user_name, state, number);
CREATE TABLE films(
  number {serial},
  job BIGINT NOT NULL REFERENCES jobs(number),
  frame BIGINT NOT NULL,
  finished BIGINT NOT NULL DEFAULT 0,
  units BIGINT NOT NULL DEFAULT 0,
  samples BIGINT NOT NULL DEFAULT 0,
  bad_samples BIGINT NOT NULL DEFAULT 0,
  UNIQUE(job, frame));
CREATE TABLE units(
  film BIGINT NOT NULL,
  tile BIGINT NOT NULL,
  kind BIGINT NOT NULL,
  pass BIGINT NOT NULL,
  attempt BIGINT NOT NULL,
  worker BIGINT NOT NULL,
  file TEXT NOT NULL,
  position BIGINT NOT NULL,
  length BIGINT NOT NULL,
  samples BIGINT NOT NULL,
  bad_samples BIGINT NOT NULL,
  PRIMARY KEY(film, tile, kind, pass)) {clustered};
CREATE TABLE garbage(
  film BIGINT NOT NULL PRIMARY KEY,
  units BIGINT NOT NULL);
CREATE TABLE workers(
  job BIGINT NOT NULL REFERENCES jobs(number),
  number BIGINT NOT NULL,
  name TEXT NOT NULL,
  PRIMARY KEY(job, number),
  UNIQUE(job, name));
CREATE TABLE warnings(
  number {serial},
  job BIGINT NOT NULL REFERENCES jobs(number),
  line TEXT NOT NULL,
  UNIQUE(job, line));
CREATE TABLE blocked_workers(
  name TEXT NOT NULL PRIMARY KEY,
  reason TEXT NOT NULL);
)";

// The members of a Roster.
constexpr char kRosterSchema[] = R"(
CREATE TABLE coordinators(
  epoch BIGINT NOT NULL PRIMARY KEY,
  name TEXT NOT NULL,
  address TEXT NOT NULL,
  renewals BIGINT NOT NULL DEFAULT 0,
  active_jobs BIGINT NOT NULL DEFAULT 0,
  workers BIGINT NOT NULL DEFAULT 0,
  slots BIGINT NOT NULL DEFAULT 0,
  demand BIGINT NOT NULL DEFAULT 0);
CREATE INDEX jobs_by_epoch ON jobs(epoch);
)";

// What was spent: it names jobs that may be deleted.
constexpr char kUsageSchema[] = R"(
CREATE TABLE usage(
  day BIGINT NOT NULL,
  job TEXT NOT NULL,
  user_name TEXT NOT NULL,
  units BIGINT NOT NULL DEFAULT 0,
  render_seconds DOUBLE PRECISION NOT NULL DEFAULT 0,
  frames BIGINT NOT NULL DEFAULT 0,
  finish_seconds DOUBLE PRECISION NOT NULL DEFAULT 0,
  PRIMARY KEY(day, job));
)";

// Messages for webhooks: those that wait are found by origin and time.
constexpr char kDeliverySchema[] = R"(
CREATE TABLE deliveries(
  number {serial},
  id TEXT NOT NULL UNIQUE,
  job BIGINT NOT NULL REFERENCES jobs(number),
  origin TEXT NOT NULL,
  url TEXT NOT NULL,
  body {blob} NOT NULL,
  created_ms BIGINT NOT NULL,
  due_ms BIGINT NOT NULL,
  state BIGINT NOT NULL DEFAULT 0,
  tries BIGINT NOT NULL DEFAULT 0,
  error TEXT NOT NULL DEFAULT '');
CREATE INDEX deliveries_by_job ON deliveries(job);
CREATE INDEX deliveries_by_due ON deliveries(state, origin, due_ms);
)";

/// Maximum number of characters of a warning that is taken over: schema 1 had no limits.
constexpr int kMaxTakenLine = 512;

/// Above the epochs of attempts up to the year 2112: those of schemas 1 and 2 began at the microseconds since
/// 1970.
constexpr int64_t kEpochFloorOfOldAttempts = 4096;

// Only SQLite has had schemas 1 and 2. Units of recorded frames and of jobs that have ended are not taken
// over.
constexpr char kSetOldTablesAside[] = R"(
ALTER TABLE jobs RENAME TO old_jobs;
ALTER TABLE units RENAME TO old_units;
ALTER TABLE frames RENAME TO old_frames;
ALTER TABLE warnings RENAME TO old_warnings;
)";
constexpr char kTakeOverRows[] = R"(
UPDATE epochs SET last = {epoch};
INSERT INTO jobs(number, id, request_id, request_digest, owner, epoch, state, user_name, error, numeric_class,
                 submitted_ms, started_ms, units_done, samples_done, bad_samples, render_seconds,
                 assemble_seconds, filter_seconds, write_seconds, warnings_left_out, scheduling, spec, files)
  SELECT number, id, request_id, x'', '', 0, state, '', error, numeric_class, submitted_ms, started_ms,
         units_done, samples_done, bad_samples, render_seconds, assemble_seconds, filter_seconds,
         write_seconds, {left_out}, x'', spec, x'' FROM old_jobs;
INSERT INTO films(job, frame, finished)
  SELECT job, frame, 1 FROM old_frames;
INSERT OR IGNORE INTO films(job, frame)
  SELECT DISTINCT units.job, units.frame FROM old_units AS units JOIN jobs ON jobs.number = units.job
  WHERE jobs.state = {active};
UPDATE films SET (units, samples, bad_samples) =
  (SELECT COUNT(*), COALESCE(SUM(samples), 0), COALESCE(SUM(bad_samples), 0) FROM old_units
   WHERE old_units.job = films.job AND old_units.frame = films.frame);
UPDATE jobs SET frames_done = (SELECT COUNT(*) FROM old_frames WHERE job = jobs.number);
INSERT INTO units(film, tile, kind, pass, attempt, worker, file, position, length, samples, bad_samples)
  SELECT films.number, tile, kind, pass, 0, 0, file, "offset", length, old.samples, old.bad_samples
  FROM old_units AS old JOIN films ON films.job = old.job AND films.frame = old.frame
       JOIN jobs ON jobs.number = old.job
  WHERE films.finished = 0 AND jobs.state = {active};
INSERT OR IGNORE INTO warnings(job, line)
  SELECT job, substr(line, 1, {line}) FROM
    (SELECT number, job, line, row_number() OVER (PARTITION BY job ORDER BY number) AS place
     FROM old_warnings)
  WHERE place <= {lines} ORDER BY number;
DROP TABLE old_warnings;
DROP TABLE old_frames;
DROP TABLE old_units;
DROP TABLE old_jobs;
)";

absl::Status RunSchema(SqlConnection& db, const std::string& schema) {
  return db.RunScript(absl::StrReplaceAll(schema, {{"{serial}", db.dialect().serial},
                                                   {"{blob}", db.dialect().blob},
                                                   {"{clustered}", db.dialect().clustered},
                                                   {"{no_error}", absl::StrCat(kNoError)}}));
}

absl::Status CreateTables(SqlConnection& db) {
  return RunSchema(db, absl::StrCat(kSchema, kRosterSchema, kUsageSchema, kDeliverySchema));
}

/// Divides the spec of an old job as CreateJob does. One that cannot be read stays as it is.
absl::Status DivideSpec(SqlConnection& db, int64_t number) {
  v1::JobSpec spec;
  bool is_readable = false;
  absl::Status status = db.Query("SELECT spec FROM jobs WHERE number = $1", {number},
                                 [&](SqlRow& row) { is_readable = spec.ParseFromString(row.Bytes()); });
  if (!status.ok() || !is_readable) return status;
  const SpecBytes parts = BytesOfSpec(spec);
  return db.Run("UPDATE jobs SET spec = $1, files = $2, request_digest = $3 WHERE number = $4",
                {SqlBytes{parts.spec}, SqlBytes{parts.files}, SqlBytes{RequestDigest(spec, {})}, number});
}

absl::Status DivideSpecs(SqlConnection& db) {
  std::vector<int64_t> numbers;
  absl::Status status =
      db.Query("SELECT number FROM jobs", {}, [&numbers](SqlRow& row) { numbers.push_back(row.Int()); });
  for (const int64_t number : numbers) {
    if (status.ok()) status = DivideSpec(db, number);
  }
  return status;
}

absl::Status TakeOver(SqlConnection& db, int64_t version) {
  if (absl::Status status = db.RunScript(kSetOldTablesAside); !status.ok()) return status;
  if (absl::Status status = CreateTables(db); !status.ok()) return status;
  const std::string sql = absl::StrReplaceAll(
      kTakeOverRows, {{"{epoch}", absl::StrCat(kEpochFloorOfOldAttempts)},
                      {"{left_out}", version == 1 ? "0" : "warnings_left_out"},
                      {"{active}", absl::StrCat(static_cast<int>(v1::JOB_STATE_SUBMITTED))},
                      {"{line}", absl::StrCat(kMaxTakenLine)},
                      {"{lines}", absl::StrCat(job::kMaxJobWarnings)}});
  if (absl::Status status = db.RunScript(sql); !status.ok()) return status;
  return DivideSpecs(db);
}

/// What was added to schema 3 or a later one.
std::string AdditionsSince(int64_t version) {
  std::string sql;
  if (version <= 3)
    sql += "ALTER TABLE jobs ADD COLUMN estimated_error DOUBLE PRECISION NOT NULL DEFAULT {no_error};";
  if (version <= 4) sql += kRosterSchema;
  if (version <= 5)
    absl::StrAppend(&sql, "ALTER TABLE jobs ADD COLUMN counted BIGINT NOT NULL DEFAULT 0;", kUsageSchema);
  if (version <= 6) sql += kDeliverySchema;
  return sql;
}

absl::Status Upgrade(SqlConnection& db) {
  const absl::StatusOr<int64_t> version = db.SchemaVersion();
  if (!version.ok()) return version.status();
  absl::Status status;
  if (*version == kSchemaVersion) return status;  // another process has just upgraded it
  if (*version == 0) {
    status = CreateTables(db);
  } else if (*version == 1 || *version == 2) {
    status = TakeOver(db, *version);
  } else if (*version >= 3 && *version < kSchemaVersion) {
    status = RunSchema(db, AdditionsSince(*version));
  } else {
    return absl::FailedPreconditionError(
        absl::StrCat("ledger: written by another version of Lumifold (schema ", *version, ", expected ",
                     kSchemaVersion, ")"));
  }
  return status.ok() ? db.SetSchemaVersion(kSchemaVersion) : status;
}

}  // namespace

absl::Status PrepareSchema(SqlConnection& db) {
  // Without a transaction that writes: a current ledger can be opened while it is written.
  const absl::StatusOr<int64_t> version = db.SchemaVersion();
  if (!version.ok()) return version.status();
  if (*version == kSchemaVersion) return absl::OkStatus();
  return db.InTransaction([&db] { return Upgrade(db); });
}

}  // namespace lumifold::ledger
