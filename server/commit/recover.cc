#include "server/commit/recover.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"
#include "proto/rpc/sha256.h"
#include "server/commit/restore_units.h"
#include "server/film/unit_log.h"
#include "server/job/job_spec.h"
#include "server/job/job_state.h"
#include "server/ledger/sqlite_job_store.h"
#include "server/storage/folder_contents.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::JobId;

namespace {

namespace fs = std::filesystem;

constexpr int64_t kDigestBytes = 64;
/// The files of an SQLite database have these after its name.
constexpr const char* kDatabaseSuffixes[] = {"", "-wal", "-shm"};

bool Exists(const std::string& path) {
  std::error_code error;
  return fs::exists(path, error);
}

/// Whether a result has the digest that was computed when it was written.
bool IsIntact(const std::string& result) {
  const absl::StatusOr<std::string> kept = ReadFile(absl::StrCat(result, ".sha256"), kDigestBytes);
  const absl::StatusOr<std::string> digest = rpc::Sha256HexOfFile(result);
  return kept.ok() && digest.ok() && *kept == *digest;
}

/// Gives a database another name; a file that does not exist is left out.
absl::Status MoveDatabase(const DataFolder& folder, const std::string& from, const std::string& to) {
  for (const char* suffix : kDatabaseSuffixes) {
    if (!Exists(from + suffix)) continue;
    if (folder.files()->Rename(from + suffix, to + suffix) != 0)
      return absl::UnavailableError(absl::StrCat(from, suffix, ": cannot be renamed"));
  }
  return folder.files()->SyncFolder(folder.root()) == 0
             ? absl::OkStatus()
             : absl::UnavailableError(absl::StrCat(folder.root(), ": cannot be synced"));
}

/// Collects what is known of the jobs of a folder in a new ledger.
class Recovery {
 public:
  Recovery(const DataFolder& folder, ledger::JobStore& store, ledger::Epoch epoch)
      : folder_(folder), store_(store), owner_{"recover", epoch} {}

  absl::Status AddJobs() {
    for (const JobId& job : JobsWithResults(folder_)) {
      const std::string path = folder_.EndedManifestPath(job);
      if (!Exists(path) || folder_.IsBeingDeleted(job)) continue;
      if (absl::Status status = Add(job, path); !status.ok()) return status;
    }
    for (const JobId& job : JobsWithFilm(folder_)) {
      if (added_.contains(job) || folder_.IsBeingDeleted(job)) continue;
      if (absl::Status status = Add(job, folder_.ManifestPath(job)); !status.ok()) return status;
    }
    return absl::OkStatus();
  }

  std::string Report() const {
    std::string report =
        absl::StrCat("jobs: ", active_, " active, ", ended_, " ended\nunits read from logs: ", units_,
                     "\nresults: ", results_, "\n");
    for (const std::string& line : left_out_) absl::StrAppend(&report, "left out: ", line, "\n");
    return report;
  }

 private:
  absl::Status LeaveOut(const absl::Status& status) {
    if (absl::IsUnavailable(status)) return status;
    left_out_.push_back(std::string(status.message()));
    return absl::OkStatus();
  }

  absl::Status Add(const JobId& job, const std::string& path) {
    const absl::StatusOr<v1::JobManifest> manifest = ReadManifest(path);
    if (!manifest.ok()) return LeaveOut(manifest.status());
    if (manifest->job_id() != job.value())
      return LeaveOut(absl::DataLossError(absl::StrCat(path, ": is of job ", manifest->job_id())));
    if (const absl::Status valid = job::NormaliseJobSpec(manifest->spec()).status(); !valid.ok())
      return LeaveOut(absl::DataLossError(absl::StrCat(path, ": ", std::string(valid.message()))));
    const absl::StatusOr<JobId> created = store_.CreateJob(JobOf(*manifest, owner_));
    if (!created.ok()) return LeaveOut(created.status());
    if (*created != job) {
      return LeaveOut(
          absl::AlreadyExistsError(absl::StrCat(path, ": has the request id of job ", created->value())));
    }
    added_.insert(job);
    const bool has_ended = job::HasEnded(manifest->end_state());
    ++(has_ended ? ended_ : active_);
    std::vector<int32_t> finished;
    if (absl::Status status = AddResults(job, has_ended, &finished); !status.ok()) return status;
    if (has_ended) return store_.EndJob({job, owner_.epoch}, {manifest->end_state(), manifest->error()});
    return AddUnits(job, finished);
  }

  /// The results of a job that has ended are all there is of it: they count as they are.
  absl::Status AddResults(const JobId& job, bool has_ended, std::vector<int32_t>* finished) {
    for (const int32_t frame : ResultsOf(folder_, job)) {
      const std::string path = folder_.ResultPath(job, frame);
      if (!has_ended && !IsIntact(path)) {
        left_out_.push_back(absl::StrCat(path, ": does not have the SHA-256 that was recorded with it"));
        continue;
      }
      if (absl::Status status = store_.RecordFrame({job, owner_.epoch}, frame, {}); !status.ok())
        return status;
      finished->push_back(frame);
      ++results_;
    }
    return absl::OkStatus();
  }

  absl::Status AddUnits(const JobId& job, const std::vector<int32_t>& finished) {
    const absl::StatusOr<ledger::JobRecord> record = store_.GetJob(job);
    if (!record.ok()) return record.status();
    const absl::StatusOr<RestoredUnits> restored =
        RestoreUnits(folder_, store_, {job, owner_.epoch}, *record, finished, std::nullopt,
                     [](const ledger::UnitRecord&) {});
    if (!restored.ok()) return LeaveOut(restored.status());
    units_ += restored->recovered;
    return absl::OkStatus();
  }

  const DataFolder& folder_;
  ledger::JobStore& store_;
  const ledger::Owner owner_;
  std::set<JobId> added_;
  int64_t active_ = 0;
  int64_t ended_ = 0;
  int64_t units_ = 0;
  int64_t results_ = 0;
  std::vector<std::string> left_out_;
};

/// Fills a new ledger at `path`, which is closed when this returns.
absl::StatusOr<std::string> BuildLedger(const DataFolder& folder, const std::string& path) {
  for (const char* suffix : kDatabaseSuffixes) {  // of a call that was interrupted
    if (absl::Status status = RemoveAll(path + suffix, folder.files()); !status.ok()) return status;
  }
  const absl::StatusOr<std::unique_ptr<ledger::JobStore>> store = ledger::OpenSqliteJobStore(path);
  if (!store.ok()) return store.status();
  const absl::StatusOr<ledger::Epoch> epoch = (*store)->NewEpoch();
  if (!epoch.ok()) return epoch.status();
  Recovery recovery(folder, **store, *epoch);
  if (absl::Status status = recovery.AddJobs(); !status.ok()) return status;
  return recovery.Report();
}

}  // namespace

absl::Status CheckHasLedger(const DataFolder& folder) {
  if (Exists(folder.LedgerPath())) return absl::OkStatus();
  const auto has_manifest = [](const std::vector<JobId>& jobs, const auto& path_of) {
    return std::any_of(jobs.begin(), jobs.end(), [&](const JobId& job) { return Exists(path_of(job)); });
  };
  const bool has_jobs =
      !JobsWithFilm(folder).empty() ||
      has_manifest(JobsWithResults(folder), [&](const JobId& job) { return folder.EndedManifestPath(job); });
  if (!has_jobs) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat(folder.root(), ": has jobs but no ledger; rebuild it with: lumifold-server ",
                   kRecoverCommand, " --data ", folder.root()));
}

absl::Status AdviseRecovery(const DataFolder& folder, const absl::Status& status) {
  if (!absl::IsDataLoss(status)) return status;
  return absl::DataLossError(absl::StrCat(std::string(status.message()),
                                          "; rebuild it with: lumifold-server ", kRecoverCommand, " --data ",
                                          folder.root()));
}

absl::StatusOr<std::string> RecoverLedger(const DataFolder& folder) {
  if (!Exists(folder.root())) return absl::NotFoundError(absl::StrCat(folder.root(), ": no such folder"));
  const absl::StatusOr<rpc::FileHandle> lock = folder.Claim();
  if (!lock.ok()) return lock.status();
  const std::string path = absl::StrCat(folder.LedgerPath(), ".recovered");
  absl::StatusOr<std::string> report = BuildLedger(folder, path);
  if (!report.ok()) return report;
  std::string old;
  for (int number = 1; old.empty() || Exists(old); ++number)
    old = absl::StrCat(folder.LedgerPath(), ".old-", number);
  if (Exists(folder.LedgerPath())) {
    if (absl::Status status = MoveDatabase(folder, folder.LedgerPath(), old); !status.ok()) return status;
    absl::StrAppend(&*report, "the old ledger is kept as ", old, "\n");
  }
  if (absl::Status status = MoveDatabase(folder, path, folder.LedgerPath()); !status.ok()) return status;
  return report;
}

}  // namespace lumifold::server
