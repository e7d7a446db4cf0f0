#include "server/ledger/sql_rows.h"

#include <algorithm>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "server/ledger/sql_jobs.h"
#include "server/ledger/sql_usage.h"

namespace lumifold::ledger {
namespace {

using job::JobId;

absl::StatusOr<int64_t> NumberOf(SqlConnection& db, const JobId& job) {
  const absl::StatusOr<std::optional<int64_t>> number =
      db.QueryInt("SELECT number FROM jobs WHERE id = $1", {job.value()});
  if (!number.ok()) return number.status();
  if (!number->has_value()) return NoJob(job);
  return **number;
}

absl::Status AddGarbage(SqlConnection& db, int64_t film, int64_t units) {
  if (units == 0) return absl::OkStatus();
  return db.Run("INSERT INTO garbage(film, units) VALUES($1, $2)", {film, units});
}

UnitRecord ReadUnit(const JobId& job, SqlRow& row) {
  UnitRecord record;
  record.unit.job = job;
  record.unit.key.frame = static_cast<int32_t>(row.Int());
  record.unit.key.tile = static_cast<int32_t>(row.Int());
  record.unit.key.kind = static_cast<v1::UnitKind>(row.Int());
  record.unit.key.pass = static_cast<int32_t>(row.Int());
  record.attempt = job::Attempt(row.Int());
  record.worker = row.Text();
  record.file = row.Text();
  record.offset = static_cast<uint64_t>(row.Int());
  record.length = static_cast<uint64_t>(row.Int());
  record.samples = row.Int();
  record.bad_samples = row.Int();
  return record;
}

/// Changes the counts of a film and of its job by -1 unit for each row.
struct Revoked {
  int64_t film = 0;
  int64_t samples = 0;
  int64_t bad_samples = 0;
};

absl::Status Uncount(SqlConnection& db, int64_t job, const std::vector<Revoked>& units) {
  std::vector<SqlParams> of_films;
  std::vector<SqlParams> of_job;
  for (const Revoked& unit : units) {
    of_films.push_back({unit.samples, unit.bad_samples, unit.film});
    of_job.push_back({unit.samples, unit.bad_samples, job});
  }
  if (absl::Status status = db.RunBatch(
          "UPDATE films SET units = units - 1, samples = samples - $1, bad_samples = bad_samples - $2"
          " WHERE number = $3",
          of_films);
      !status.ok()) {
    return status;
  }
  return db.RunBatch(
      "UPDATE jobs SET units_done = units_done - 1, samples_done = samples_done - $1,"
      " bad_samples = bad_samples - $2 WHERE number = $3",
      of_job);
}

}  // namespace

absl::Status NoJob(const JobId& job) {
  return absl::NotFoundError(absl::StrCat("no job ", absl::Utf8SafeCEscape(job.value())));
}

absl::Status InsertJob(SqlConnection& db, const NewJob& job, JobId* id) {
  const SpecBytes spec = BytesOfSpec(job.spec);
  const std::string scheduling = job.scheduling.SerializeAsString();
  const std::string digest = RequestDigest(job.spec, job.scheduling);
  const absl::StatusOr<std::optional<int64_t>> inserted = db.QueryInt(
      "INSERT INTO jobs(id, request_id, request_digest, owner, epoch, state, user_name, submitted_ms, "
      "scheduling, spec,"
      " files) VALUES($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11) ON CONFLICT DO NOTHING "
      "RETURNING number",
      {job.id.value(), job.request_id, SqlBytes{digest}, job.owner.name, job.owner.epoch.value(),
       int64_t{v1::JOB_STATE_SUBMITTED}, job.scheduling.user(), absl::ToUnixMillis(job.submitted),
       SqlBytes{scheduling}, SqlBytes{spec.spec}, SqlBytes{spec.files}});
  if (!inserted.ok()) return inserted.status();
  *id = job.id;
  if (inserted->has_value()) return absl::OkStatus();
  const absl::StatusOr<std::optional<JobId>> recorded = QueryRequest(db, job);
  if (!recorded.ok()) return recorded.status();
  if (!recorded->has_value()) {
    const absl::StatusOr<std::optional<int64_t>> other =
        db.QueryInt("SELECT number FROM jobs WHERE id = $1", {job.id.value()});
    if (!other.ok()) return other.status();
    if (other->has_value()) {
      return absl::AlreadyExistsError(absl::StrCat("job ", job.id.value(),
                                                   " exists, of another request than '",
                                                   absl::Utf8SafeCEscape(job.request_id), "'"));
    }
    // Another coordinator has deleted it since the conflict.
    return absl::AbortedError(absl::StrCat("the job of request_id '", absl::Utf8SafeCEscape(job.request_id),
                                           "' was deleted meanwhile"));
  }
  *id = **recorded;
  return absl::OkStatus();
}

absl::StatusOr<std::optional<JobId>> QueryRequest(SqlConnection& db, const NewJob& job) {
  std::optional<JobId> recorded;
  std::string recorded_digest;
  if (absl::Status status =
          db.Query("SELECT id, request_digest FROM jobs WHERE request_id = $1", {job.request_id},
                   [&](SqlRow& row) {
                     recorded = JobId(row.Text());
                     recorded_digest = row.Bytes();
                   });
      !status.ok()) {
    return status;
  }
  if (!recorded.has_value() || recorded_digest == RequestDigest(job.spec, job.scheduling)) return recorded;
  return absl::AlreadyExistsError(absl::StrCat("request_id '", absl::Utf8SafeCEscape(job.request_id),
                                               "' is that of job ", recorded->value(),
                                               ", which has another spec or scheduling"));
}

absl::Status ClaimJobs(SqlConnection& db, const Owner& owner, ClaimedJobs* claimed) {
  constexpr int64_t kActive = v1::JOB_STATE_SUBMITTED;
  if (absl::Status status = db.Run("UPDATE jobs SET owner = $1, epoch = $2 WHERE state = $3 AND epoch <= $2",
                                   {owner.name, owner.epoch.value(), kActive});
      !status.ok()) {
    return status;
  }
  absl::StatusOr<std::vector<JobRow>> rows =
      QueryJobs(db, /*with_files=*/true, "WHERE state = $1 ORDER BY number", {kActive});
  if (!rows.ok()) return rows.status();
  if (absl::Status status = AddWarnings(db, &*rows); !status.ok()) return status;
  for (JobRow& row : *rows) {
    if (!row.damage.ok()) {
      claimed->damaged.push_back({row.record.id, row.damage});
    } else if (row.record.owner.epoch != owner.epoch) {
      return OtherOwner(row.record.id, row.record.owner.epoch, owner.epoch);
    } else {
      claimed->jobs.push_back(std::move(row.record));
    }
  }
  return absl::OkStatus();
}

absl::Status ReopenJob(SqlConnection& db, int64_t job, const Owner& owner, const Reopening& reopening) {
  for (const int32_t frame : reopening.frames) {
    if (absl::Status status = DiscardFilms(db, job, "frame = $2", {frame}); !status.ok()) return status;
  }
  const SpecBytes bytes = BytesOfSpec(reopening.spec);
  return db.Run(
      "UPDATE jobs SET state = $1, error = '', owner = $2, epoch = $3, spec = $4, files = $5, scheduling = "
      "$7,"
      " user_name = $8, counted = $9,"
      " units_done = (SELECT COALESCE(SUM(units), 0) FROM films WHERE job = $6),"
      " samples_done = (SELECT COALESCE(SUM(samples), 0) FROM films WHERE job = $6),"
      " bad_samples = (SELECT COALESCE(SUM(films.bad_samples), 0) FROM films WHERE job = $6),"
      " frames_done = (SELECT COUNT(*) FROM films WHERE job = $6 AND finished = 1),"
      " numeric_class = CASE WHEN EXISTS (SELECT 1 FROM films WHERE job = $6 AND (finished = 1 OR units > 0))"
      " THEN numeric_class ELSE '' END WHERE number = $6",
      {int64_t{v1::JOB_STATE_SUBMITTED}, owner.name, owner.epoch.value(), SqlBytes{bytes.spec},
       SqlBytes{bytes.files}, job, SqlBytes{reopening.scheduling.SerializeAsString()},
       reopening.scheduling.user(), reopening.counted.value()});
}

absl::Status RemoveJob(SqlConnection& db, int64_t job) {
  if (absl::Status status = DiscardFilms(db, job, "finished >= 0", {}); !status.ok()) return status;
  for (const char* sql : {"DELETE FROM warnings WHERE job = $1", "DELETE FROM workers WHERE job = $1",
                          "DELETE FROM deliveries WHERE job = $1", "DELETE FROM jobs WHERE number = $1"}) {
    if (absl::Status status = db.Run(sql, {job}); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status VisitUnits(SqlConnection& db, const JobId& job, std::optional<int32_t> frame,
                        absl::FunctionRef<void(const UnitRecord&)> visit) {
  const absl::StatusOr<int64_t> number = NumberOf(db, job);
  if (!number.ok()) return number.status();
  SqlParams params = {*number};
  if (frame.has_value()) params.emplace_back(int64_t{*frame});
  bool is_readable = true;
  absl::Status status = db.Query(
      absl::StrCat(
          "SELECT films.frame, units.tile, units.kind, units.pass, units.attempt, COALESCE(workers.name, ''),"
          " units.file, units.position, units.length, units.samples, units.bad_samples"
          " FROM films JOIN units ON units.film = films.number"
          " LEFT JOIN workers ON workers.job = films.job AND workers.number = units.worker"
          " WHERE films.job = $1 AND films.finished = 0",
          frame.has_value() ? " AND films.frame = $2" : "",
          " ORDER BY films.frame, units.tile, units.kind, units.pass"),
      params, [&](SqlRow& row) {
        const UnitRecord record = ReadUnit(job, row);
        is_readable &= row.is_readable();
        if (is_readable) visit(record);
      });
  if (!status.ok() || is_readable) return status;
  return absl::InternalError(absl::StrCat("ledger: a row of a unit of job ", job.value(),
                                          " is damaged: a column is of a wrong type"));
}

absl::Status DeleteUnits(SqlConnection& db, int64_t job, absl::Span<const job::UnitKey> units) {
  std::vector<SqlParams> batch;
  for (const job::UnitKey& key : units)
    batch.push_back({job, key.frame, key.tile, int64_t{key.kind}, key.pass});
  std::vector<Revoked> revoked;
  const absl::Status status = db.RunBatch(
      "DELETE FROM units WHERE film = (SELECT number FROM films WHERE job = $1 AND frame = $2 AND finished = "
      "0)"
      " AND tile = $3 AND kind = $4 AND pass = $5 RETURNING film, samples, bad_samples",
      batch, [&revoked](size_t, SqlRow& row) {
        Revoked& unit = revoked.emplace_back();
        unit.film = row.Int();
        unit.samples = row.Int();
        unit.bad_samples = row.Int();
      });
  return status.ok() ? Uncount(db, job, revoked) : status;
}

absl::Status FinishFilm(SqlConnection& db, int64_t job, int32_t frame, const v1::FrameReport& report) {
  // A frame may have no units here: those of one that was filtered again are not in the ledger.
  if (absl::Status status = db.Run(
          "INSERT INTO films(job, frame) VALUES($1, $2) ON CONFLICT(job, frame) DO NOTHING", {job, frame});
      !status.ok()) {
    return status;
  }
  std::optional<int64_t> film;
  int64_t units = 0;
  if (absl::Status status = db.Query("UPDATE films SET finished = 1 WHERE job = $1 AND frame = $2 AND "
                                     "finished = 0 RETURNING number, units",
                                     {job, frame},
                                     [&](SqlRow& row) {
                                       film = row.Int();
                                       units = row.Int();
                                     });
      !status.ok()) {
    return status;
  }
  if (!film.has_value()) return absl::OkStatus();
  if (absl::Status status = AddGarbage(db, *film, units); !status.ok()) return status;
  const v1::StageTimes& times = report.times();
  const double error = report.has_estimated_error() ? report.estimated_error() : kNoError;
  if (absl::Status status = AddFrameUsage(db, job, report); !status.ok()) return status;
  return db.Run(
      "UPDATE jobs SET frames_done = frames_done + 1,"
      " render_seconds = CASE WHEN render_seconds > $1 THEN render_seconds ELSE $1 END,"
      " assemble_seconds = assemble_seconds + $2, filter_seconds = filter_seconds + $3,"
      " write_seconds = write_seconds + $4,"
      " estimated_error = CASE WHEN estimated_error > $5 THEN estimated_error ELSE $5 END WHERE number = $6",
      {times.render_seconds(), times.assemble_seconds(), times.filter_seconds(), times.write_seconds(), error,
       job});
}

absl::Status DiscardFilms(SqlConnection& db, int64_t job, const std::string& condition,
                          const SqlParams& params) {
  SqlParams all = {job};
  all.insert(all.end(), params.begin(), params.end());
  // The units of a finished film are garbage already.
  if (absl::Status status = db.Run(
          absl::StrCat("INSERT INTO garbage(film, units) SELECT number, units FROM films WHERE job = $1 AND ",
                       condition, " AND finished = 0 AND units > 0"),
          all);
      !status.ok()) {
    return status;
  }
  return db.Run(absl::StrCat("DELETE FROM films WHERE job = $1 AND ", condition), all);
}

absl::StatusOr<std::vector<int32_t>> QueryFinishedFrames(SqlConnection& db, const JobId& job) {
  const absl::StatusOr<int64_t> number = NumberOf(db, job);
  if (!number.ok()) return number.status();
  std::vector<int32_t> frames;
  const absl::Status status =
      db.Query("SELECT frame FROM films WHERE job = $1 AND finished = 1 ORDER BY frame", {*number},
               [&frames](SqlRow& row) { frames.push_back(static_cast<int32_t>(row.Int())); });
  if (!status.ok()) return status;
  return frames;
}

absl::StatusOr<std::vector<std::string>> QueryDeliverers(SqlConnection& db, const JobId& job) {
  const absl::StatusOr<int64_t> number = NumberOf(db, job);
  if (!number.ok()) return number.status();
  std::vector<std::string> names;
  const absl::Status status = db.Query("SELECT name FROM workers WHERE job = $1", {*number},
                                       [&names](SqlRow& row) { names.push_back(row.Text()); });
  if (!status.ok()) return status;
  return names;
}

absl::StatusOr<int64_t> DeleteGarbage(SqlConnection& db, int64_t max_rows) {
  while (max_rows > 0) {
    const absl::StatusOr<std::optional<int64_t>> film = db.QueryInt(
        absl::StrCat("SELECT film FROM garbage ORDER BY film LIMIT 1", db.dialect().for_update), {});
    if (!film.ok()) return film.status();
    if (!film->has_value()) break;
    int64_t deleted = 0;
    absl::Status status = db.Query(
        "DELETE FROM units WHERE film = $1 AND (tile, kind, pass) IN"
        " (SELECT tile, kind, pass FROM units WHERE film = $1 ORDER BY tile, kind, pass LIMIT $2) RETURNING "
        "film",
        {**film, max_rows}, [&deleted](SqlRow&) { ++deleted; });
    if (!status.ok()) return status;
    status = deleted < max_rows
                 ? db.Run("DELETE FROM garbage WHERE film = $1", {**film})
                 : db.Run("UPDATE garbage SET units = units - $1 WHERE film = $2", {deleted, **film});
    if (!status.ok()) return status;
    max_rows -= deleted;
  }
  const absl::StatusOr<std::optional<int64_t>> left =
      db.QueryInt("SELECT CAST(COALESCE(SUM(units), 0) AS BIGINT) FROM garbage", {});
  if (!left.ok()) return left.status();
  return left->value_or(0);
}

absl::StatusOr<std::vector<BlockedWorker>> QueryBlockedWorkers(SqlConnection& db) {
  std::vector<BlockedWorker> workers;
  const absl::Status status =
      db.Query("SELECT name, reason FROM blocked_workers", {}, [&workers](SqlRow& row) {
        std::string name = row.Text();
        workers.push_back({std::move(name), row.Text()});
      });
  if (!status.ok()) return status;
  // Here, because the order of texts in a database depends on its locale.
  std::sort(workers.begin(), workers.end(),
            [](const BlockedWorker& a, const BlockedWorker& b) { return a.name < b.name; });
  return workers;
}

}  // namespace lumifold::ledger
