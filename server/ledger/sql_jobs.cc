#include "server/ledger/sql_jobs.h"

#include <xxhash.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/job/limits.h"
#include "server/job/plan.h"

namespace lumifold::ledger {
namespace {

using job::JobId;

constexpr char kColumns[] =
    "number, id, owner, epoch, state, error, numeric_class, submitted_ms, started_ms, units_done, "
    "samples_done, "
    "bad_samples, frames_done, render_seconds, assemble_seconds, filter_seconds, write_seconds, "
    "warnings_left_out, estimated_error, counted, "
    "scheduling, spec";

void ReadColumns(SqlRow& row, JobRecord* job) {
  job->owner.name = row.Text();
  job->owner.epoch = Epoch(row.Int());
  job->state = static_cast<v1::JobState>(row.Int());
  job->error = row.Text();
  job->numeric_class = row.Text();
  job->submitted = absl::FromUnixMillis(row.Int());
  if (const int64_t started_ms = row.Int(); started_ms != 0) job->started = absl::FromUnixMillis(started_ms);
  job->done.units = row.Int();
  job->done.samples = row.Int();
  job->done.bad_samples = row.Int();
  job->done.frames = static_cast<int32_t>(row.Int());
  job->times.set_render_seconds(row.Real());
  job->times.set_assemble_seconds(row.Real());
  job->times.set_filter_seconds(row.Real());
  job->times.set_write_seconds(row.Real());
  job->warnings_left_out = row.Int();
  if (const double error = row.Real(); error > kNoError) job->estimated_error = error;
  job->counted = job::Attempt(row.Int());
}

JobRow ReadJob(SqlRow& row, bool with_files) {
  JobRow job;
  job.number = row.Int();
  job.record.id = JobId(row.Text());
  if (!row.is_readable()) job.record.id = JobId(absl::StrCat("of row ", job.number));
  ReadColumns(row, &job.record);
  const bool has_scheduling = job.record.scheduling.ParseFromString(row.Bytes());
  std::string spec = row.Bytes();
  if (with_files) spec += row.Bytes();
  const char* damaged = nullptr;
  if (!row.is_readable()) damaged = "a column is of a wrong type";
  if (damaged == nullptr && !v1::JobState_IsValid(job.record.state)) damaged = "its state is unknown";
  if (damaged == nullptr && !has_scheduling) damaged = "its scheduling cannot be read";
  if (damaged == nullptr && !job.record.spec.ParseFromString(spec)) damaged = "its spec cannot be read";
  if (damaged != nullptr) {
    job.damage = absl::InternalError(
        absl::StrCat("ledger: the row of job ", job.record.id.value(), " is damaged: ", damaged));
  }
  return job;
}

void AppendHashed(XXH3_state_t* state, const std::string& bytes) {
  const uint64_t size = bytes.size();
  XXH3_128bits_update(state, &size, sizeof size);
  XXH3_128bits_update(state, bytes.data(), bytes.size());
}

}  // namespace

SpecBytes BytesOfSpec(const v1::JobSpec& spec) {
  v1::JobSpec files;
  *files.mutable_scene()->mutable_dependencies() = spec.scene().dependencies();
  v1::JobSpec rest = spec;
  if (rest.has_scene()) rest.mutable_scene()->clear_dependencies();
  return {rest.SerializeAsString(), files.scene().dependencies().empty() ? "" : files.SerializeAsString()};
}

std::string RequestDigest(const v1::JobSpec& spec, const v1::Scheduling& scheduling) {
  v1::Scheduling requested = scheduling;
  requested.clear_trace_id();  // of the call, not of the request
  requested.clear_turn_ms();
  requested.clear_gaps();
  XXH3_state_t* const state = XXH3_createState();
  XXH3_128bits_reset(state);
  AppendHashed(state, job::UnplannedSpec(spec).SerializeAsString());
  AppendHashed(state, requested.SerializeAsString());
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(state));
  XXH3_freeState(state);
  return {reinterpret_cast<const char*>(canonical.digest), sizeof canonical.digest};
}

absl::StatusOr<std::vector<JobRow>> QueryJobs(SqlConnection& db, bool with_files,
                                              const std::string& condition, const SqlParams& params) {
  std::vector<JobRow> jobs;
  const absl::Status status =
      db.Query(absl::StrCat("SELECT ", kColumns, with_files ? ", files" : "", " FROM jobs ", condition),
               params, [&](SqlRow& row) { jobs.push_back(ReadJob(row, with_files)); });
  if (!status.ok()) return status;
  return jobs;
}

absl::Status AddWarnings(SqlConnection& db, std::vector<JobRow>* jobs) {
  std::vector<SqlParams> batch;
  std::vector<JobRow*> readable;
  for (JobRow& job : *jobs) {
    if (!job.damage.ok()) continue;
    batch.push_back({job.number, job::kMaxJobWarnings});
    readable.push_back(&job);
  }
  return db.RunBatch(
      "SELECT line FROM warnings WHERE job = $1 ORDER BY number LIMIT $2", batch,
      [&readable](size_t i, SqlRow& row) { readable[i]->record.warnings.push_back(row.Text()); });
}

absl::StatusOr<JobPage> QueryPage(SqlConnection& db, const JobFilter& filter) {
  constexpr int64_t kBeyondAll = INT64_MAX;
  const int64_t limit = int64_t{filter.limit} + 1;  // one more tells whether there is a next page
  SqlParams params = {filter.before.value_or(kBeyondAll), limit};
  std::string range = "number < $1";
  if (!filter.user.empty()) {
    params.emplace_back(filter.user);
    absl::StrAppend(&range, " AND user_name = $", params.size());
  }
  // Each state has its own order in an index, so the first of each state are merged.
  std::string first_of_states;
  for (const v1::JobState state : filter.states) {
    params.emplace_back(int64_t{state});
    absl::StrAppend(&first_of_states, first_of_states.empty() ? "" : " UNION ALL ",
                    "SELECT number FROM (SELECT number FROM jobs WHERE ", range, " AND state = $",
                    params.size(), " ORDER BY number DESC LIMIT $2) AS of_state", params.size());
  }
  const std::string condition =
      first_of_states.empty() ? range : absl::StrCat("number IN (", first_of_states, ") AND number < $1");
  absl::StatusOr<std::vector<JobRow>> rows = QueryJobs(
      db, /*with_files=*/false, absl::StrCat("WHERE ", condition, " ORDER BY number DESC LIMIT $2"), params);
  if (!rows.ok()) return rows.status();
  JobPage page;
  if (rows->size() == static_cast<size_t>(limit)) {
    rows->pop_back();
    page.next = rows->back().number;
  }
  for (JobRow& row : *rows) {
    if (row.damage.ok()) {
      page.jobs.push_back(std::move(row.record));
    } else {
      page.damaged.push_back({row.record.id, row.damage});
    }
  }
  return page;
}

absl::StatusOr<std::vector<LockedJob>> LockJobs(SqlConnection& db, const std::vector<JobId>& jobs) {
  std::vector<LockedJob> rows(jobs.size());
  std::vector<SqlParams> batch;
  for (size_t i = 0; i < jobs.size(); ++i) {
    rows[i].status = absl::NotFoundError(absl::StrCat("no job ", jobs[i].value()));
    batch.push_back({jobs[i].value()});
  }
  const absl::Status status = db.RunBatch(
      absl::StrCat("SELECT number, epoch, state FROM jobs WHERE id = $1", db.dialect().for_update), batch,
      [&](size_t i, SqlRow& row) {
        rows[i].number = row.Int();
        rows[i].epoch = Epoch(row.Int());
        rows[i].has_ended = row.Int() != v1::JOB_STATE_SUBMITTED;
        rows[i].status = row.is_readable()
                             ? absl::OkStatus()
                             : absl::InternalError(absl::StrCat("ledger: the row of job ", jobs[i].value(),
                                                                " is damaged: a column is of a wrong type"));
      });
  if (!status.ok()) return status;
  return rows;
}

absl::Status CheckOwned(const OwnedJob& job, const LockedJob& row) {
  if (!row.status.ok()) return row.status;
  if (row.epoch != job.epoch) return OtherOwner(job.job, row.epoch, job.epoch);
  if (row.has_ended)
    return absl::FailedPreconditionError(absl::StrCat("job ", job.job.value(), " has ended"));
  return absl::OkStatus();
}

}  // namespace lumifold::ledger
