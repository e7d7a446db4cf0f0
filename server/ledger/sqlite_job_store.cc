#include "server/ledger/sqlite_job_store.h"

#include <map>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "server/job/limits.h"
#include "server/ledger/sqlite_connection.h"

namespace lumifold::ledger {
namespace {

using job::JobId;

constexpr int kSchemaVersion = 2;

// The key of units has the order in which a frame is assembled. Times are milliseconds since 1970; 0 means
// "not yet".
constexpr char kSchema[] = R"(
CREATE TABLE jobs(
  number INTEGER PRIMARY KEY AUTOINCREMENT,
  id TEXT NOT NULL UNIQUE,
  request_id TEXT NOT NULL UNIQUE,
  spec BLOB NOT NULL,
  state INTEGER NOT NULL,
  error TEXT NOT NULL DEFAULT '',
  numeric_class TEXT NOT NULL DEFAULT '',
  submitted_ms INTEGER NOT NULL,
  started_ms INTEGER NOT NULL DEFAULT 0,
  units_done INTEGER NOT NULL DEFAULT 0,
  samples_done INTEGER NOT NULL DEFAULT 0,
  bad_samples INTEGER NOT NULL DEFAULT 0,
  render_seconds REAL NOT NULL DEFAULT 0,
  assemble_seconds REAL NOT NULL DEFAULT 0,
  filter_seconds REAL NOT NULL DEFAULT 0,
  write_seconds REAL NOT NULL DEFAULT 0,
  warnings_left_out INTEGER NOT NULL DEFAULT 0);
CREATE TABLE units(
  job INTEGER NOT NULL REFERENCES jobs(number),
  frame INTEGER NOT NULL,
  tile INTEGER NOT NULL,
  kind INTEGER NOT NULL,
  pass INTEGER NOT NULL,
  file TEXT NOT NULL,
  offset INTEGER NOT NULL,
  length INTEGER NOT NULL,
  samples INTEGER NOT NULL,
  bad_samples INTEGER NOT NULL,
  PRIMARY KEY(job, frame, tile, kind, pass)) WITHOUT ROWID;
CREATE TABLE frames(
  job INTEGER NOT NULL REFERENCES jobs(number),
  frame INTEGER NOT NULL,
  PRIMARY KEY(job, frame)) WITHOUT ROWID;
CREATE TABLE warnings(
  number INTEGER PRIMARY KEY AUTOINCREMENT,
  job INTEGER NOT NULL REFERENCES jobs(number),
  line TEXT NOT NULL,
  UNIQUE(job, line));
)";

/// Maximum number of characters of a warning that are read.
constexpr int kMaxReadLine = 512;

/// Changes a ledger of schema 1 into one of schema 2.
constexpr char kSchemaFrom1[] = "ALTER TABLE jobs ADD COLUMN warnings_left_out INTEGER NOT NULL DEFAULT 0;";

constexpr char kJobColumns[] =
    "SELECT number, id, spec, state, error, numeric_class, submitted_ms, started_ms, units_done, "
    "samples_done,"
    " bad_samples, (SELECT COUNT(*) FROM frames WHERE frames.job = jobs.number), render_seconds, "
    "assemble_seconds,"
    " filter_seconds, write_seconds, warnings_left_out FROM jobs ";
constexpr char kUnitColumns[] =
    "SELECT frame, tile, kind, pass, file, offset, length, samples, bad_samples FROM units ";

UnitRecord ReadUnit(const JobId& job, SqliteStatement& row) {
  UnitRecord record;
  record.unit.job = job;
  record.unit.key.frame = static_cast<int32_t>(row.Int());
  record.unit.key.tile = static_cast<int32_t>(row.Int());
  record.unit.key.kind = static_cast<v1::UnitKind>(row.Int());
  record.unit.key.pass = static_cast<int32_t>(row.Int());
  record.file = row.Text();
  record.offset = static_cast<uint64_t>(row.Int());
  record.length = static_cast<uint64_t>(row.Int());
  record.samples = row.Int();
  record.bad_samples = row.Int();
  return record;
}

class SqliteJobStore final : public JobStore {
 public:
  explicit SqliteJobStore(SqliteConnection connection) : db_(std::move(connection)) {}

  absl::Status Prepare();

  absl::StatusOr<JobId> CreateJob(const NewJob& job) override;
  absl::StatusOr<JobRecord> GetJob(const JobId& job) override;
  absl::StatusOr<std::vector<JobRecord>> ListJobs(int limit) override;
  absl::StatusOr<std::vector<JobRecord>> UnfinishedJobs() override;
  absl::Status CommitUnits(absl::Span<const UnitRecord> units, absl::Span<const JobUpdate> updates) override;
  absl::Status RevokeUnits(const JobId& job, absl::Span<const UnitRecord> units) override;
  absl::Status ForEachUnit(const JobId& job, std::optional<int32_t> frame,
                           absl::FunctionRef<void(const UnitRecord&)> visit) override;
  absl::Status RecordFrame(const JobId& job, int32_t frame, const v1::StageTimes& times) override;
  absl::StatusOr<std::vector<int32_t>> FinishedFrames(const JobId& job) override;
  absl::Status EndJob(const JobId& job, v1::JobState state, const std::string& error) override;

 private:
  absl::StatusOr<int64_t> NumberOf(const JobId& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<std::vector<JobRecord>> ReadJobs(SqliteStatement rows) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status InsertUnits(absl::Span<const UnitRecord> units) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status CountUnits(absl::Span<const UnitRecord> units) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status UpdateJob(const JobUpdate& update) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status DeleteUnits(int64_t number, absl::Span<const UnitRecord> units)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status InsertWarnings(const JobUpdate& update) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status InsertFrame(int64_t number, int32_t frame, const v1::StageTimes& times)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Mutex mutex_;
  SqliteConnection db_ ABSL_GUARDED_BY(mutex_);
};

absl::Status SqliteJobStore::Prepare() {
  absl::MutexLock lock(&mutex_);
  if (absl::Status status =
          db_.Execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA foreign_keys=ON;");
      !status.ok()) {
    return status;
  }
  int64_t version = -1;
  {
    SqliteStatement row = db_.Prepare("PRAGMA user_version");
    if (row.Next()) version = row.Int();
    if (!row.status().ok()) return row.status();
  }
  if (version == kSchemaVersion) return absl::OkStatus();
  if (version != 0 && version != 1) {
    return absl::FailedPreconditionError(
        absl::StrCat("ledger: written by another version of Lumifold (schema ", version, ", expected ",
                     kSchemaVersion, ")"));
  }
  if (absl::Status status = db_.Execute("BEGIN IMMEDIATE"); !status.ok()) return status;
  const char* const change = version == 0 ? kSchema : kSchemaFrom1;
  return db_.EndTransaction(db_.Execute(absl::StrCat(change, "PRAGMA user_version=", kSchemaVersion, ";")));
}

absl::StatusOr<int64_t> SqliteJobStore::NumberOf(const JobId& job) {
  SqliteStatement row = db_.Prepare("SELECT number FROM jobs WHERE id = ?");
  if (row.Bind(job.value()).Next()) return row.Int();
  if (!row.status().ok()) return row.status();
  return absl::NotFoundError(absl::StrCat("no job ", job.value()));
}

absl::StatusOr<JobId> SqliteJobStore::CreateJob(const NewJob& job) {
  absl::MutexLock lock(&mutex_);
  SqliteStatement insert = db_.Prepare(
      "INSERT INTO jobs(id, request_id, spec, state, submitted_ms) VALUES(?, ?, ?, ?, ?)"
      " ON CONFLICT(request_id) DO NOTHING");
  insert.Bind(job.id.value()).Bind(job.request_id).BindBlob(job.spec.SerializeAsString());
  insert.Bind(int64_t{v1::JOB_STATE_QUEUED}).Bind(absl::ToUnixMillis(job.submitted));
  if (absl::Status status = insert.Run(); !status.ok()) return status;
  if (insert.ChangedRows() == 1) return job.id;
  SqliteStatement row = db_.Prepare("SELECT id FROM jobs WHERE request_id = ?");
  if (row.Bind(job.request_id).Next()) return JobId(row.Text());
  return row.status();
}

absl::StatusOr<std::vector<JobRecord>> SqliteJobStore::ReadJobs(SqliteStatement rows) {
  std::vector<JobRecord> jobs;
  while (rows.Next()) {
    JobRecord& job = jobs.emplace_back();
    const int64_t number = rows.Int();
    job.id = JobId(rows.Text());
    if (!job.spec.ParseFromString(rows.Text())) {
      return absl::DataLossError(absl::StrCat("ledger: the spec of job ", job.id.value(), " cannot be read"));
    }
    job.state = static_cast<v1::JobState>(rows.Int());
    job.error = rows.Text();
    job.numeric_class = rows.Text();
    job.submitted = absl::FromUnixMillis(rows.Int());
    const int64_t started_ms = rows.Int();
    if (started_ms != 0) job.started = absl::FromUnixMillis(started_ms);
    job.units_done = rows.Int();
    job.samples_done = rows.Int();
    job.bad_samples = rows.Int();
    job.frames_done = static_cast<int32_t>(rows.Int());
    job.times.set_render_seconds(rows.Real());
    job.times.set_assemble_seconds(rows.Real());
    job.times.set_filter_seconds(rows.Real());
    job.times.set_write_seconds(rows.Real());
    job.warnings_left_out = rows.Int();
    // Ledgers of schema 1 may have more and longer lines.
    SqliteStatement lines =
        db_.Prepare("SELECT substr(line, 1, ?) FROM warnings WHERE job = ? ORDER BY number LIMIT ?");
    lines.Bind(int64_t{kMaxReadLine}).Bind(number).Bind(int64_t{job::kMaxJobWarnings});
    while (lines.Next()) job.warnings.push_back(lines.Text());
    if (!lines.status().ok()) return lines.status();
  }
  if (!rows.status().ok()) return rows.status();
  return jobs;
}

absl::StatusOr<JobRecord> SqliteJobStore::GetJob(const JobId& job) {
  absl::MutexLock lock(&mutex_);
  SqliteStatement rows = db_.Prepare(absl::StrCat(kJobColumns, "WHERE id = ?"));
  rows.Bind(job.value());
  absl::StatusOr<std::vector<JobRecord>> found = ReadJobs(std::move(rows));
  if (!found.ok()) return found.status();
  if (found->empty()) return absl::NotFoundError(absl::StrCat("no job ", job.value()));
  return std::move(found->front());
}

absl::StatusOr<std::vector<JobRecord>> SqliteJobStore::ListJobs(int limit) {
  absl::MutexLock lock(&mutex_);
  SqliteStatement rows = db_.Prepare(absl::StrCat(kJobColumns, "ORDER BY number DESC LIMIT ?"));
  rows.Bind(int64_t{limit});
  return ReadJobs(std::move(rows));
}

absl::StatusOr<std::vector<JobRecord>> SqliteJobStore::UnfinishedJobs() {
  absl::MutexLock lock(&mutex_);
  SqliteStatement rows = db_.Prepare(absl::StrCat(kJobColumns, "WHERE state = ? ORDER BY number"));
  rows.Bind(int64_t{v1::JOB_STATE_QUEUED});
  return ReadJobs(std::move(rows));
}

absl::Status SqliteJobStore::InsertUnits(absl::Span<const UnitRecord> units) {
  SqliteStatement insert = db_.Prepare(
      "INSERT INTO units(job, frame, tile, kind, pass, file, offset, length, samples, bad_samples)"
      " VALUES((SELECT number FROM jobs WHERE id = ?), ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  for (const UnitRecord& record : units) {
    const job::UnitKey& key = record.unit.key;
    insert.Bind(record.unit.job.value()).Bind(int64_t{key.frame}).Bind(int64_t{key.tile});
    insert.Bind(int64_t{key.kind}).Bind(int64_t{key.pass}).Bind(record.file);
    insert.Bind(static_cast<int64_t>(record.offset)).Bind(static_cast<int64_t>(record.length));
    insert.Bind(record.samples).Bind(record.bad_samples);
    if (absl::Status status = insert.Run(); !status.ok()) {
      return {status.code(), absl::StrCat(std::string(status.message()), " (", Describe(record.unit), ")")};
    }
    insert.Reset();
  }
  return absl::OkStatus();
}

absl::Status SqliteJobStore::CountUnits(absl::Span<const UnitRecord> units) {
  SqliteStatement update = db_.Prepare(
      "UPDATE jobs SET units_done = units_done + 1, samples_done = samples_done + ?, bad_samples = "
      "bad_samples + ?"
      " WHERE id = ?");
  for (const UnitRecord& record : units) {
    update.Bind(record.samples).Bind(record.bad_samples).Bind(record.unit.job.value());
    if (absl::Status status = update.Run(); !status.ok()) return status;
    update.Reset();
  }
  return absl::OkStatus();
}

absl::Status SqliteJobStore::UpdateJob(const JobUpdate& update) {
  SqliteStatement bind_class =
      db_.Prepare("UPDATE jobs SET numeric_class = ?, started_ms = ? WHERE id = ? AND numeric_class = ''");
  bind_class.Bind(update.numeric_class).Bind(absl::ToUnixMillis(update.started)).Bind(update.job.value());
  if (absl::Status status = bind_class.Run(); !status.ok()) return status;
  return update.warnings.empty() ? absl::OkStatus() : InsertWarnings(update);
}

absl::Status SqliteJobStore::InsertWarnings(const JobUpdate& update) {
  const absl::StatusOr<int64_t> number = NumberOf(update.job);
  if (!number.ok()) return number.status();
  int64_t left_out = 0;
  std::map<std::string, bool> is_kept;
  SqliteStatement insert = db_.Prepare(
      "INSERT INTO warnings(job, line) SELECT ?1, ?2"
      " WHERE (SELECT COUNT(*) FROM warnings WHERE job = ?1) < ?3 ON CONFLICT DO NOTHING");
  SqliteStatement find = db_.Prepare("SELECT 1 FROM warnings WHERE job = ? AND line = ?");
  for (const std::string& line : update.warnings) {
    const auto [entry, is_new] = is_kept.emplace(line, true);
    if (is_new) {
      insert.Bind(*number).Bind(line).Bind(int64_t{job::kMaxJobWarnings});
      if (absl::Status status = insert.Run(); !status.ok()) return status;
      insert.Reset();
      entry->second = find.Bind(*number).Bind(line).Next();
      if (!find.status().ok()) return find.status();
      find.Reset();
    }
    if (!entry->second) ++left_out;
  }
  if (left_out == 0) return absl::OkStatus();
  SqliteStatement count =
      db_.Prepare("UPDATE jobs SET warnings_left_out = warnings_left_out + ? WHERE number = ?");
  return count.Bind(left_out).Bind(*number).Run();
}

absl::Status SqliteJobStore::CommitUnits(absl::Span<const UnitRecord> units,
                                         absl::Span<const JobUpdate> updates) {
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = db_.Execute("BEGIN IMMEDIATE"); !status.ok()) return status;
  absl::Status outcome = InsertUnits(units);
  if (outcome.ok()) outcome = CountUnits(units);
  for (const JobUpdate& item : updates) {
    if (outcome.ok()) outcome = UpdateJob(item);
  }
  return db_.EndTransaction(outcome);
}

absl::Status SqliteJobStore::DeleteUnits(int64_t number, absl::Span<const UnitRecord> units) {
  SqliteStatement remove =
      db_.Prepare("DELETE FROM units WHERE job = ? AND frame = ? AND tile = ? AND kind = ? AND pass = ?");
  SqliteStatement update = db_.Prepare(
      "UPDATE jobs SET units_done = units_done - 1, samples_done = samples_done - ?,"
      " bad_samples = bad_samples - ? WHERE number = ?");
  for (const UnitRecord& record : units) {
    const job::UnitKey& key = record.unit.key;
    remove.Bind(number).Bind(int64_t{key.frame}).Bind(int64_t{key.tile});
    remove.Bind(int64_t{key.kind}).Bind(int64_t{key.pass});
    if (absl::Status status = remove.Run(); !status.ok()) return status;
    const bool was_committed = remove.ChangedRows() == 1;
    remove.Reset();
    if (!was_committed) continue;
    update.Bind(record.samples).Bind(record.bad_samples).Bind(number);
    if (absl::Status status = update.Run(); !status.ok()) return status;
    update.Reset();
  }
  return absl::OkStatus();
}

absl::Status SqliteJobStore::RevokeUnits(const JobId& job, absl::Span<const UnitRecord> units) {
  absl::MutexLock lock(&mutex_);
  const absl::StatusOr<int64_t> number = NumberOf(job);
  if (!number.ok()) return number.status();
  if (absl::Status status = db_.Execute("BEGIN IMMEDIATE"); !status.ok()) return status;
  return db_.EndTransaction(DeleteUnits(*number, units));
}

absl::Status SqliteJobStore::ForEachUnit(const JobId& job, std::optional<int32_t> frame,
                                         absl::FunctionRef<void(const UnitRecord&)> visit) {
  absl::MutexLock lock(&mutex_);
  const absl::StatusOr<int64_t> number = NumberOf(job);
  if (!number.ok()) return number.status();
  SqliteStatement rows =
      db_.Prepare(absl::StrCat(kUnitColumns, "WHERE job = ?", frame.has_value() ? " AND frame = ?" : "",
                               " ORDER BY frame, tile, kind, pass"));
  rows.Bind(*number);
  if (frame.has_value()) rows.Bind(int64_t{*frame});
  while (rows.Next()) visit(ReadUnit(job, rows));
  return rows.status();
}

absl::Status SqliteJobStore::InsertFrame(int64_t number, int32_t frame, const v1::StageTimes& times) {
  SqliteStatement insert = db_.Prepare("INSERT OR IGNORE INTO frames(job, frame) VALUES(?, ?)");
  if (absl::Status status = insert.Bind(number).Bind(int64_t{frame}).Run(); !status.ok()) return status;
  if (insert.ChangedRows() == 0) return absl::OkStatus();
  SqliteStatement update = db_.Prepare(
      "UPDATE jobs SET render_seconds = max(render_seconds, ?), assemble_seconds = assemble_seconds + ?,"
      " filter_seconds = filter_seconds + ?, write_seconds = write_seconds + ? WHERE number = ?");
  update.Bind(times.render_seconds()).Bind(times.assemble_seconds());
  return update.Bind(times.filter_seconds()).Bind(times.write_seconds()).Bind(number).Run();
}

absl::Status SqliteJobStore::RecordFrame(const JobId& job, int32_t frame, const v1::StageTimes& times) {
  absl::MutexLock lock(&mutex_);
  const absl::StatusOr<int64_t> number = NumberOf(job);
  if (!number.ok()) return number.status();
  if (absl::Status status = db_.Execute("BEGIN IMMEDIATE"); !status.ok()) return status;
  return db_.EndTransaction(InsertFrame(*number, frame, times));
}

absl::StatusOr<std::vector<int32_t>> SqliteJobStore::FinishedFrames(const JobId& job) {
  absl::MutexLock lock(&mutex_);
  const absl::StatusOr<int64_t> number = NumberOf(job);
  if (!number.ok()) return number.status();
  SqliteStatement rows = db_.Prepare("SELECT frame FROM frames WHERE job = ? ORDER BY frame");
  rows.Bind(*number);
  std::vector<int32_t> frames;
  while (rows.Next()) frames.push_back(static_cast<int32_t>(rows.Int()));
  if (!rows.status().ok()) return rows.status();
  return frames;
}

absl::Status SqliteJobStore::EndJob(const JobId& job, v1::JobState state, const std::string& error) {
  absl::MutexLock lock(&mutex_);
  const absl::StatusOr<int64_t> number = NumberOf(job);
  if (!number.ok()) return number.status();
  SqliteStatement update = db_.Prepare("UPDATE jobs SET state = ?, error = ? WHERE number = ? AND state = ?");
  update.Bind(int64_t{state}).Bind(error).Bind(*number);
  return update.Bind(int64_t{v1::JOB_STATE_QUEUED}).Run();
}

}  // namespace

absl::StatusOr<std::unique_ptr<JobStore>> OpenSqliteJobStore(const std::string& path) {
  absl::StatusOr<SqliteConnection> connection = SqliteConnection::Open(path);
  if (!connection.ok()) return connection.status();
  auto store = std::make_unique<SqliteJobStore>(*std::move(connection));
  if (absl::Status status = store->Prepare(); !status.ok()) {
    return absl::Status(status.code(), absl::StrCat(path, ": ", std::string(status.message())));
  }
  return store;
}

}  // namespace lumifold::ledger
