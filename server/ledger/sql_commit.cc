#include "server/ledger/sql_commit.h"

#include <map>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/job/limits.h"
#include "server/ledger/sql_jobs.h"
#include "server/ledger/sql_usage.h"

namespace lumifold::ledger {
namespace {

using job::JobId;

/// What is added to the counts of a job or a film.
struct Counts {
  int64_t units = 0;
  int64_t samples = 0;
  int64_t bad_samples = 0;

  void Add(const UnitRecord& unit) {
    ++units;
    samples += unit.samples;
    bad_samples += unit.bad_samples;
  }
};

/// A commit of one job on its way into the ledger.
struct Plan {
  const JobCommit* commit = nullptr;
  int64_t job = 0;  // number of its row
  absl::Status outcome;
  std::vector<const UnitRecord*> units;  // those that are not committed yet
};

using FilmKey = std::pair<int64_t, int32_t>;        // number of the job, frame
using WorkerKey = std::pair<int64_t, std::string>;  // number of the job, name

absl::Status CheckAttempts(const JobCommit& commit) {
  for (const UnitRecord& unit : commit.units) {
    const Epoch epoch = EpochOf(unit.attempt);
    if (epoch == commit.job.epoch || commit.recovered) continue;
    return absl::AbortedError(absl::StrCat(Describe(unit.unit), " was leased in epoch ", epoch.value(),
                                           ", and its job belongs to epoch ", commit.job.epoch.value()));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<Plan>> MakePlans(SqlConnection& db, absl::Span<const JobCommit> commits) {
  // Locked in the order of their ids, so that two transactions cannot wait for each other.
  std::set<JobId> ids;
  for (const JobCommit& commit : commits) ids.insert(commit.job.job);
  const absl::StatusOr<std::vector<LockedJob>> rows = LockJobs(db, {ids.begin(), ids.end()});
  if (!rows.ok()) return rows.status();
  std::vector<Plan> plans;
  for (const JobCommit& commit : commits) {
    const auto place = std::distance(ids.begin(), ids.find(commit.job.job));
    const LockedJob& row = (*rows)[static_cast<size_t>(place)];
    Plan& plan = plans.emplace_back();
    plan.commit = &commit;
    plan.job = row.number;
    plan.outcome = CheckOwned(commit.job, row);
    if (plan.outcome.ok()) plan.outcome = CheckAttempts(commit);
  }
  return plans;
}

/// What the ledger knows of a unit: nothing, its row, or that its frame is recorded.
struct Known {
  bool is_finished = false;
  bool is_committed = false;
  int64_t attempt = 0;
  std::string file;
  int64_t position = 0;
  int64_t length = 0;

  bool IsSame(const UnitRecord& unit) const {
    return attempt == unit.attempt.value() && file == unit.file &&
           position == static_cast<int64_t>(unit.offset) && length == static_cast<int64_t>(unit.length);
  }
};

bool IsSame(const UnitRecord& a, const UnitRecord& b) {
  return a.attempt == b.attempt && a.file == b.file && a.offset == b.offset && a.length == b.length;
}

absl::StatusOr<std::vector<Known>> FindUnits(SqlConnection& db, const std::vector<Plan>& plans) {
  std::vector<SqlParams> batch;
  for (const Plan& plan : plans) {
    if (!plan.outcome.ok()) continue;
    for (const UnitRecord& unit : plan.commit->units) {
      const job::UnitKey& key = unit.unit.key;
      batch.push_back({plan.job, key.frame, key.tile, int64_t{key.kind}, key.pass});
    }
  }
  std::vector<Known> known(batch.size());
  const absl::Status status = db.RunBatch(
      "SELECT films.finished, COALESCE(units.attempt, -1), COALESCE(units.file, ''), "
      "COALESCE(units.position, 0),"
      " COALESCE(units.length, 0) FROM films LEFT JOIN units ON units.film = films.number AND units.tile = $3"
      " AND units.kind = $4 AND units.pass = $5 WHERE films.job = $1 AND films.frame = $2",
      batch, [&known](size_t i, SqlRow& row) {
        known[i].is_finished = row.Int() != 0;
        known[i].attempt = row.Int();
        known[i].is_committed = known[i].attempt >= 0;
        known[i].file = row.Text();
        known[i].position = row.Int();
        known[i].length = row.Int();
      });
  if (!status.ok()) return status;
  return known;
}

/// Chooses the units that are recorded, and refuses the plans that would record a unit twice.
absl::Status ChooseUnits(SqlConnection& db, std::vector<Plan>* plans) {
  const absl::StatusOr<std::vector<Known>> found = FindUnits(db, *plans);
  if (!found.ok()) return found.status();
  std::map<job::UnitRef, const UnitRecord*> chosen;
  size_t next = 0;
  for (Plan& plan : *plans) {
    if (!plan.outcome.ok()) continue;
    std::map<job::UnitRef, const UnitRecord*> of_plan;
    for (const UnitRecord& unit : plan.commit->units) {
      const Known& known = (*found)[next++];
      if (known.is_committed && !known.is_finished && known.IsSame(unit)) continue;
      const auto earlier = chosen.find(unit.unit);
      if (earlier != chosen.end() && IsSame(*earlier->second, unit)) continue;
      if (known.is_finished || known.is_committed || earlier != chosen.end() ||
          !of_plan.emplace(unit.unit, &unit).second) {
        plan.outcome = absl::AlreadyExistsError(
            absl::StrCat(Describe(unit.unit),
                         known.is_finished ? " is of a frame that is finished" : " is already committed"));
      }
      plan.units.push_back(&unit);
    }
    if (plan.outcome.ok()) chosen.merge(of_plan);
  }
  return absl::OkStatus();
}

/// Counts the units of each film, and returns the films' numbers.
absl::StatusOr<std::map<FilmKey, int64_t>> CountFilms(SqlConnection& db, const std::vector<Plan>& plans) {
  std::map<FilmKey, Counts> counts;
  for (const Plan& plan : plans) {
    if (!plan.outcome.ok()) continue;
    for (const UnitRecord* unit : plan.units) counts[{plan.job, unit->unit.key.frame}].Add(*unit);
  }
  std::vector<SqlParams> batch;
  std::vector<FilmKey> keys;
  for (const auto& [key, sum] : counts) {
    batch.push_back({key.first, key.second, sum.units, sum.samples, sum.bad_samples});
    keys.push_back(key);
  }
  std::map<FilmKey, int64_t> numbers;
  const absl::Status status = db.RunBatch(
      "INSERT INTO films(job, frame, units, samples, bad_samples) VALUES($1, $2, $3, $4, $5)"
      " ON CONFLICT(job, frame) DO UPDATE SET units = films.units + excluded.units,"
      " samples = films.samples + excluded.samples, bad_samples = films.bad_samples + excluded.bad_samples"
      " RETURNING number",
      batch, [&](size_t i, SqlRow& row) { numbers[keys[i]] = row.Int(); });
  if (!status.ok()) return status;
  return numbers;
}

/// Numbers of the workers within their jobs; those that have none get one.
absl::StatusOr<std::map<WorkerKey, int64_t>> NumberWorkers(SqlConnection& db,
                                                           const std::vector<Plan>& plans) {
  std::map<WorkerKey, int64_t> numbers;
  for (const Plan& plan : plans) {
    if (!plan.outcome.ok()) continue;
    for (const UnitRecord* unit : plan.units) numbers[{plan.job, unit->worker}] = 0;
  }
  std::erase_if(numbers, [](const auto& entry) { return entry.first.second.empty(); });
  const auto run = [&db, &numbers](const std::string& sql) {
    std::vector<SqlParams> batch;
    std::vector<int64_t*> found;
    for (auto& [key, number] : numbers) {
      if (number != 0) continue;
      batch.push_back({key.first, key.second});
      found.push_back(&number);
    }
    return db.RunBatch(sql, batch, [&found](size_t i, SqlRow& row) { *found[i] = row.Int(); });
  };
  absl::Status status = run("SELECT number FROM workers WHERE job = $1 AND name = $2");
  if (status.ok()) {
    status =
        run("INSERT INTO workers(job, number, name)"
            " SELECT $1, COALESCE(MAX(number), 0) + 1, $2 FROM workers WHERE job = $1 RETURNING number");
  }
  if (!status.ok()) return status;
  return numbers;
}

absl::Status InsertUnits(SqlConnection& db, const std::vector<Plan>& plans) {
  absl::StatusOr<std::map<FilmKey, int64_t>> films = CountFilms(db, plans);
  if (!films.ok()) return films.status();
  absl::StatusOr<std::map<WorkerKey, int64_t>> workers = NumberWorkers(db, plans);
  if (!workers.ok()) return workers.status();
  std::vector<SqlParams> batch;
  for (const Plan& plan : plans) {
    if (!plan.outcome.ok()) continue;
    for (const UnitRecord* unit : plan.units) {
      const job::UnitKey& key = unit->unit.key;
      const int64_t worker = unit->worker.empty() ? 0 : workers->at({plan.job, unit->worker});
      batch.push_back({films->at({plan.job, key.frame}), key.tile, int64_t{key.kind}, key.pass,
                       unit->attempt.value(), worker, unit->file, static_cast<int64_t>(unit->offset),
                       static_cast<int64_t>(unit->length), unit->samples, unit->bad_samples});
    }
  }
  return db.RunBatch(
      "INSERT INTO units(film, tile, kind, pass, attempt, worker, file, position, length, samples, "
      "bad_samples)"
      " VALUES($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)",
      batch);
}

struct NewLines {
  std::vector<std::string> kept;
  int64_t left_out = 0;
};

/// Divides the warnings of a commit into new lines and those that are left out.
NewLines DivideLines(const std::vector<std::string>& lines, std::set<std::string> known) {
  NewLines result;
  for (const std::string& line : lines) {
    if (known.contains(line)) continue;
    if (known.size() < size_t{job::kMaxJobWarnings}) {
      known.insert(line);
      result.kept.push_back(line);
    } else {
      ++result.left_out;
    }
  }
  return result;
}

/// Inserts the new warnings of the jobs, and returns how many were left out, by number of the job.
absl::StatusOr<std::map<int64_t, int64_t>> InsertWarnings(SqlConnection& db, const std::vector<Plan>& plans) {
  std::map<int64_t, std::vector<std::string>> lines;  // by number of the job
  for (const Plan& plan : plans) {
    if (!plan.outcome.ok() || plan.commit->warnings.empty()) continue;
    std::vector<std::string>& of_job = lines[plan.job];
    of_job.insert(of_job.end(), plan.commit->warnings.begin(), plan.commit->warnings.end());
  }
  std::vector<SqlParams> jobs;
  for (const auto& [job, of_job] : lines) jobs.push_back({job});
  std::vector<std::set<std::string>> known(jobs.size());
  if (absl::Status status = db.RunBatch("SELECT line FROM warnings WHERE job = $1", jobs,
                                        [&known](size_t i, SqlRow& row) { known[i].insert(row.Text()); });
      !status.ok()) {
    return status;
  }
  std::map<int64_t, int64_t> left_out;
  std::vector<SqlParams> batch;
  std::vector<std::vector<std::string>> kept;  // what the batch refers to
  size_t next = 0;
  for (const auto& [job, of_job] : lines) {
    NewLines divided = DivideLines(of_job, std::move(known[next++]));
    left_out[job] = divided.left_out;
    for (const std::string& line : kept.emplace_back(std::move(divided.kept))) batch.push_back({job, line});
  }
  if (absl::Status status = db.RunBatch("INSERT INTO warnings(job, line) VALUES($1, $2)", batch);
      !status.ok())
    return status;
  return left_out;
}

absl::Status CountJobs(SqlConnection& db, const std::vector<Plan>& plans) {
  absl::StatusOr<std::map<int64_t, int64_t>> left_out = InsertWarnings(db, plans);
  if (!left_out.ok()) return left_out.status();
  std::vector<SqlParams> batch;
  for (const Plan& plan : plans) {
    if (!plan.outcome.ok()) continue;
    Counts sum;
    for (const UnitRecord* unit : plan.units) sum.Add(*unit);
    const absl::Time started = plan.commit->started;
    const int64_t started_ms = started == absl::InfinitePast() ? 0 : absl::ToUnixMillis(started);
    batch.push_back({sum.units, sum.samples, sum.bad_samples, std::exchange((*left_out)[plan.job], 0),
                     started_ms, plan.commit->numeric_class, plan.job});
  }
  // The time and the class of the first commit stay.
  return db.RunBatch(
      "UPDATE jobs SET units_done = units_done + $1, samples_done = samples_done + $2,"
      " bad_samples = bad_samples + $3, warnings_left_out = warnings_left_out + $4,"
      " started_ms = CASE WHEN numeric_class = '' THEN $5 ELSE started_ms END,"
      " numeric_class = CASE WHEN numeric_class = '' THEN $6 ELSE numeric_class END WHERE number = $7",
      batch);
}

/// What the units that are recorded have cost, by job and day.
std::vector<WorkOfDay> WorkOf(const std::vector<Plan>& plans) {
  std::map<std::pair<int64_t, int64_t>, Work> sums;
  for (const Plan& plan : plans) {
    if (!plan.outcome.ok()) continue;
    for (const UnitRecord* unit : plan.units) {
      if (!unit->cost.has_value()) continue;
      Work& work = sums[{plan.job, DayOf(unit->cost->at)}];
      ++work.units;
      work.render_seconds += unit->cost->seconds;
    }
  }
  std::vector<WorkOfDay> works;
  for (const auto& [key, work] : sums) works.push_back({key.first, key.second, work});
  return works;
}

}  // namespace

absl::StatusOr<std::vector<absl::Status>> CommitJobs(SqlConnection& db, absl::Span<const JobCommit> commits) {
  absl::StatusOr<std::vector<Plan>> plans = MakePlans(db, commits);
  if (!plans.ok()) return plans.status();
  if (absl::Status status = ChooseUnits(db, &*plans); !status.ok()) return status;
  if (absl::Status status = InsertUnits(db, *plans); !status.ok()) return status;
  if (absl::Status status = CountJobs(db, *plans); !status.ok()) return status;
  if (absl::Status status = AddUsage(db, WorkOf(*plans)); !status.ok()) return status;
  std::vector<absl::Status> outcomes;
  for (Plan& plan : *plans) outcomes.push_back(std::move(plan.outcome));
  return outcomes;
}

absl::Status CountKept(SqlConnection& db, int64_t job, const JobCommit& commit) {
  if (absl::Status status = CheckAttempts(commit); !status.ok()) return status;
  std::vector<Plan> plans(1);
  plans.front() = {.commit = &commit, .job = job, .outcome = {}, .units = {}};
  for (const UnitRecord& unit : commit.units) plans.front().units.push_back(&unit);
  if (absl::Status status = CountFilms(db, plans).status(); !status.ok()) return status;
  if (absl::Status status = NumberWorkers(db, plans).status(); !status.ok()) return status;
  if (absl::Status status = CountJobs(db, plans); !status.ok()) return status;
  return AddUsage(db, WorkOf(plans));
}

}  // namespace lumifold::ledger
