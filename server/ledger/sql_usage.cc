#include "server/ledger/sql_usage.h"

#include <string>

#include "absl/strings/str_cat.h"

namespace lumifold::ledger {

int64_t DayOf(absl::Time time) {
  return absl::ToCivilDay(time, absl::UTCTimeZone()) - absl::CivilDay(1970, 1, 1);
}

absl::Status AddUsage(SqlConnection& db, const std::vector<WorkOfDay>& works) {
  std::vector<SqlParams> batch;
  for (const WorkOfDay& of_day : works) {
    const Work& work = of_day.work;
    batch.push_back(
        {of_day.day, work.units, work.render_seconds, work.frames, work.finish_seconds, of_day.job});
  }
  return db.RunBatch(
      "INSERT INTO usage(day, job, user_name, units, render_seconds, frames, finish_seconds)"
      " SELECT CAST($1 AS BIGINT), id, user_name, CAST($2 AS BIGINT), CAST($3 AS DOUBLE PRECISION),"
      " CAST($4 AS BIGINT), CAST($5 AS DOUBLE PRECISION) FROM jobs WHERE number = $6"
      " ON CONFLICT(day, job) DO UPDATE SET units = usage.units + excluded.units,"
      " render_seconds = usage.render_seconds + excluded.render_seconds, frames = usage.frames + "
      "excluded.frames,"
      " finish_seconds = usage.finish_seconds + excluded.finish_seconds",
      batch);
}

absl::Status AddFrameUsage(SqlConnection& db, int64_t job, const v1::FrameReport& report) {
  if (report.finished_unix_ms() == 0) return absl::OkStatus();
  const int64_t day = DayOf(absl::FromUnixMillis(report.finished_unix_ms()));
  const Work work = {.frames = 1, .finish_seconds = report.core_seconds()};
  if (absl::Status status = AddUsage(db, {{job, day, work}}); !status.ok()) return status;
  return db.Run("DELETE FROM usage WHERE day < $1", {day - kUsageDays});
}

absl::StatusOr<std::vector<JobUsage>> QueryUsage(SqlConnection& db, const UsageFilter& filter) {
  SqlParams params = {DayOf(filter.since), DayOf(filter.until), int64_t{filter.limit}};
  std::string of_user;
  if (!filter.user.empty()) {
    params.emplace_back(filter.user);
    of_user = " AND user_name = $4";
  }
  std::vector<JobUsage> usage;
  bool is_readable = true;
  absl::Status status = db.Query(
      absl::StrCat(
          "SELECT job, user_name, CAST(SUM(units) AS BIGINT), SUM(render_seconds),"
          " CAST(SUM(frames) AS BIGINT), SUM(finish_seconds) FROM usage WHERE day >= $1 AND day < $2",
          of_user,
          " GROUP BY job, user_name ORDER BY SUM(render_seconds) + SUM(finish_seconds) DESC, job LIMIT $3"),
      params, [&](SqlRow& row) {
        JobUsage& of_job = usage.emplace_back();
        of_job.job = job::JobId(row.Text());
        of_job.user = row.Text();
        of_job.work.units = row.Int();
        of_job.work.render_seconds = row.Real();
        of_job.work.frames = row.Int();
        of_job.work.finish_seconds = row.Real();
        is_readable &= row.is_readable();
      });
  if (!status.ok()) return status;
  if (!is_readable)
    return absl::InternalError("ledger: a row of usage is damaged: a column is of a wrong type");
  return usage;
}

}  // namespace lumifold::ledger
