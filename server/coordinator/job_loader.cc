#include "server/coordinator/job_loader.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/commit/restore_units.h"
#include "server/film/unit_log.h"
#include "server/finish/estimate_round.h"
#include "server/job/gaps.h"
#include "server/job/job_spec.h"
#include "server/job/job_state.h"
#include "server/scheduler/scheduler.h"
#include "server/storage/folder_contents.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::JobId;

namespace {

/// Reads the digests of audited units from their records.
class DigestReader {
 public:
  DigestReader(const DataFolder& folder, double share) : folder_(folder), share_(share) {}

  /// Empty for a unit that is not audited, and where its record cannot be read.
  std::string Of(const ledger::UnitRecord& unit) {
    if (!scheduler::IsAudited(unit.unit, share_)) return "";
    if (unit.file != file_) {  // the units of a frame follow one another
      file_ = unit.file;
      log_ = film::UnitLogReader::Open(folder_.PathOf(file_));
    }
    return log_.ok() ? log_->ReadDigest({unit.offset, unit.length}).value_or("") : "";
  }

 private:
  const DataFolder& folder_;
  const double share_;
  std::string file_;
  absl::StatusOr<film::UnitLogReader> log_ = absl::NotFoundError("");
};

}  // namespace

absl::StatusOr<LoadedJob> JobLoader::Load(const ledger::JobRecord& record) {
  resources_->LabelJob(record.id, record.scheduling);
  LoadedJob loaded;
  loaded.record = record;
  absl::Status status = job::NormaliseJobSpec(record.spec).status();
  if (!status.ok()) {
    // Recorded by a version with other limits. No message could carry it to a worker.
    loaded.error = absl::StrCat("the job's spec is not valid: ", std::string(status.message()));
    return loaded;
  }
  status = LoadProgress(&loaded);
  if (absl::IsInternal(status) || absl::IsFailedPrecondition(status)) {
    loaded.error = std::string(status.message());
    return loaded;
  }
  if (!status.ok()) return status;
  return loaded;
}

absl::StatusOr<std::optional<LoadedJob>> JobLoader::Load(const JobId& job) {
  const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
  if (!record.ok()) return record.status();
  if (job::HasEnded(record->state)) {
    cleanup_->janitor().JobEnded(job, record->state, record->error);
    return std::nullopt;
  }
  absl::StatusOr<LoadedJob> loaded = Load(*record);
  if (!loaded.ok()) return loaded.status();
  return *std::move(loaded);
}

absl::Status JobLoader::LoadProgress(LoadedJob* loaded) {
  const JobId id = loaded->record.id;
  absl::StatusOr<std::vector<int32_t>> finished = resources_->store->FinishedFrames(id);
  if (!finished.ok()) return finished.status();
  loaded->finished = *std::move(finished);
  absl::StatusOr<std::vector<std::string>> deliverers = resources_->store->DeliverersOf(id);
  if (!deliverers.ok()) return deliverers.status();
  loaded->deliverers = *std::move(deliverers);
  std::vector<int32_t> left_out = job::SkippedFrames(loaded->record.scheduling.gaps());
  left_out.insert(left_out.end(), loaded->finished.begin(), loaded->finished.end());
  std::sort(left_out.begin(), left_out.end());
  DigestReader digests(resources_->folder, loaded->record.scheduling.audit_share());
  absl::StatusOr<RestoredUnits> units =
      RestoreUnits(resources_->folder, *resources_->store, resources_->Owned(id), loaded->record, left_out,
                   resources_->options.wall_now(), [&](const ledger::UnitRecord& unit) {
                     loaded->units.push_back({unit.unit.key, unit.worker, digests.Of(unit)});
                   });
  if (!units.ok()) return units.status();
  loaded->committed_bytes = std::move(units->committed_bytes);
  loaded->frames = std::move(units->frames);
  if (absl::Status status = LoadRounds(loaded); !status.ok()) return status;
  if (units->recovered > 0) {  // they have changed the job's class and counts
    resources_->log().info("event=units_recovered job={} units={}", id.value(), units->recovered);
    absl::StatusOr<ledger::JobRecord> counted = resources_->store->GetJob(id);
    if (!counted.ok()) return counted.status();
    loaded->record = *std::move(counted);
  }
  absl::StatusOr<std::vector<job::Prerequisite>> after = prerequisites_.Read(loaded->record.scheduling);
  if (!after.ok()) return after.status();
  loaded->after = *std::move(after);
  return RestoreFiles(loaded->record, loaded->finished);
}

absl::Status JobLoader::LoadRounds(LoadedJob* loaded) const {
  const ledger::JobRecord& record = loaded->record;
  const DataFolder& folder = resources_->folder;
  if (!record.spec.has_adaptive()) return absl::OkStatus();
  for (const int32_t frame : loaded->frames) {
    if (std::binary_search(loaded->finished.begin(), loaded->finished.end(), frame)) continue;
    absl::StatusOr<job::FrameRounds> rounds = ReadRounds(folder, record.id, record.spec, frame);
    if (absl::IsDataLoss(rounds.status())) {  // the same is estimated again, from the same units
      resources_->log().error("event=rounds_damaged job={} frame={} error={}", record.id.value(), frame,
                              logging::Quoted(rounds.status().message()));
      if (absl::Status status = RemoveAll(folder.RoundsPath(record.id, frame), folder.files()); !status.ok())
        return status;
      rounds = job::FrameRounds(record.spec);
    }
    if (!rounds.ok()) return rounds.status();
    loaded->rounds[frame] = std::make_shared<const job::FrameRounds>(*std::move(rounds));
  }
  return absl::OkStatus();
}

absl::Status JobLoader::RestoreFiles(const ledger::JobRecord& record, const std::vector<int32_t>& finished) {
  const JobId& id = record.id;
  const DataFolder& folder = resources_->folder;
  for (const int32_t frame : finished) cleanup_->janitor().FrameFinished(id, frame);
  for (const int32_t frame : ResultsOf(folder, id)) {
    // The result before the frame was reopened, or one that was written just before the last run ended.
    if (std::binary_search(finished.begin(), finished.end(), frame)) continue;
    RemoveAll(folder.ResultPath(id, frame), folder.files()).IgnoreError();  // it is written again
  }
  if (!absl::IsNotFound(ReadManifest(folder.ManifestPath(id)).status())) return absl::OkStatus();
  // Submitted to a version without manifests. The ledger does not give the request id back.
  return WriteManifest(folder, ManifestOf({.id = id,
                                           .request_id = absl::StrCat("of ", id.value()),
                                           .spec = record.spec,
                                           .scheduling = record.scheduling,
                                           .submitted = record.submitted,
                                           .owner = resources_->owner}));
}

absl::StatusOr<std::vector<ledger::JobRecord>> JobLoader::FindForgottenJobs() {
  const DataFolder& folder = resources_->folder;
  ledger::JobStore* const store = resources_->store;
  std::vector<ledger::JobRecord> forgotten;
  for (const JobId& job : JobsWithFilm(folder)) {
    if (folder.IsBeingDeleted(job)) continue;
    const absl::StatusOr<ledger::JobRecord> row = store->GetJob(job);
    if (row.ok() || absl::IsInternal(row.status())) continue;
    if (!absl::IsNotFound(row.status())) return row.status();
    const absl::StatusOr<v1::JobManifest> manifest = ReadManifest(folder.ManifestPath(job));
    // Of a submission, or a removal of its files, that ended half-way: only an empty folder can be removed.
    if (absl::IsNotFound(manifest.status()) && folder.files()->Remove(folder.FilmPath(job)) == 0) continue;
    if (!manifest.ok()) {
      resources_->log().warn("event=film_without_job folder={} error={}",
                             logging::Quoted(folder.FilmPath(job)),
                             logging::Quoted(manifest.status().message()));
      continue;
    }
    const absl::StatusOr<JobId> id = store->CreateJob(JobOf(*manifest, resources_->owner));
    if (IsStorageError(id.status())) return id.status();
    // The client has submitted it again, as another job.
    if (id.ok() && *id != job) cleanup_->DeleteFiles(folder.FilmPath(job));
    if (!id.ok() || *id != job) continue;
    absl::StatusOr<ledger::JobRecord> created = store->GetJob(job);
    if (!created.ok()) return created.status();
    forgotten.push_back(*std::move(created));
  }
  return forgotten;
}

}  // namespace lumifold::server
