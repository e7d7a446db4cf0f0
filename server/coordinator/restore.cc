// What a coordinator finds when it starts: the jobs of the ledger, and what the data folder has beyond it.
#include <spdlog/logger.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/commit/restore_units.h"
#include "server/coordinator/coordinator.h"
#include "server/film/unit_log.h"
#include "server/finish/estimate_round.h"
#include "server/job/job_spec.h"
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

// No other thread has the coordinator yet, so that nothing here needs the lock; and nothing may hold it, because these
// functions read and write the ledger and files.

absl::Status Coordinator::Restore() ABSL_NO_THREAD_SAFETY_ANALYSIS {
  const absl::StatusOr<ledger::ClaimedJobs> claimed = store_->ClaimUnfinishedJobs(owner_);
  if (!claimed.ok()) return claimed.status();
  for (const ledger::DamagedJob& job : claimed->damaged) {
    // Its film stays, so that `lumifold-server recover` can save it.
    options_.log->error("event=job_damaged job={} error={}", job.id.value(),
                        logging::Quoted(std::string(job.error.message())));
  }
  for (const ledger::JobRecord& record : claimed->jobs) {
    if (absl::Status status = RestoreJob(record); !status.ok()) return status;
  }
  absl::StatusOr<std::vector<ledger::JobRecord>> forgotten = FindForgottenJobs();
  if (!forgotten.ok()) return forgotten.status();
  for (const ledger::JobRecord& record : *forgotten) {
    options_.log->warn(
        "event=job_adopted job={} reason=\"its manifest is here, but not its row in the ledger\"",
        record.id.value());
    if (absl::Status status = RestoreJob(record); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<ledger::JobRecord>> Coordinator::FindForgottenJobs()
    ABSL_NO_THREAD_SAFETY_ANALYSIS {
  std::vector<ledger::JobRecord> forgotten;
  for (const JobId& job : folder_.JobsWithFilm()) {
    if (active_jobs_.contains(job) || ending_jobs_.contains(job) || folder_.IsBeingDeleted(job)) continue;
    const absl::StatusOr<ledger::JobRecord> row = store_->GetJob(job);
    if (row.ok() || absl::IsInternal(row.status())) continue;
    if (!absl::IsNotFound(row.status())) return row.status();
    const absl::StatusOr<v1::JobManifest> manifest = ReadManifest(folder_.ManifestPath(job));
    // Of a submission, or a removal of its files, that ended half-way: only an empty folder can be removed.
    if (absl::IsNotFound(manifest.status()) && folder_.files()->Remove(folder_.FilmPath(job)) == 0) continue;
    if (!manifest.ok()) {
      options_.log->warn("event=film_without_job folder={} error={}", logging::Quoted(folder_.FilmPath(job)),
                         logging::Quoted(std::string(manifest.status().message())));
      continue;
    }
    const absl::StatusOr<JobId> id = store_->CreateJob(JobOf(*manifest, owner_));
    if (IsStorageError(id.status())) return id.status();
    // The client has submitted it again, as another job.
    if (id.ok() && *id != job) DeleteFiles(folder_.FilmPath(job));
    if (!id.ok() || *id != job) continue;
    absl::StatusOr<ledger::JobRecord> created = store_->GetJob(job);
    if (!created.ok()) return created.status();
    forgotten.push_back(*std::move(created));
  }
  return forgotten;
}

absl::Status Coordinator::RestoreJob(const ledger::JobRecord& record) {
  absl::StatusOr<LoadedJob> loaded = LoadJob(record);
  if (!loaded.ok()) return loaded.status();
  for (const auto& [frame, bytes] : loaded->committed_bytes)
    committer_->RestoreLog({record.id, frame}, bytes);
  absl::MutexLock lock(&mutex_);
  EnterJob(*loaded);
  return absl::OkStatus();
}

absl::StatusOr<Coordinator::LoadedJob> Coordinator::LoadJob(const ledger::JobRecord& record) {
  LabelJob(record.id, record.scheduling);
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

absl::Status Coordinator::LoadProgress(LoadedJob* loaded) {
  const JobId id = loaded->record.id;
  absl::StatusOr<std::vector<int32_t>> finished = store_->FinishedFrames(id);
  if (!finished.ok()) return finished.status();
  loaded->finished = *std::move(finished);
  DigestReader digests(folder_, loaded->record.scheduling.audit_share());
  absl::StatusOr<RestoredUnits> units = RestoreUnits(
      folder_, *store_, Owned(id), loaded->record, loaded->finished, [&](const ledger::UnitRecord& unit) {
        loaded->units.push_back({unit.unit.key, unit.worker, digests.Of(unit)});
      });
  if (!units.ok()) return units.status();
  loaded->committed_bytes = std::move(units->committed_bytes);
  loaded->frames = std::move(units->frames);
  if (absl::Status status = LoadRounds(loaded); !status.ok()) return status;
  if (units->recovered > 0) {  // they have changed the job's class and counts
    options_.log->info("event=units_recovered job={} units={}", id.value(), units->recovered);
    absl::StatusOr<ledger::JobRecord> counted = store_->GetJob(id);
    if (!counted.ok()) return counted.status();
    loaded->record = *std::move(counted);
  }
  absl::StatusOr<std::vector<job::Prerequisite>> after = ReadPrerequisites(loaded->record.scheduling);
  if (!after.ok()) return after.status();
  loaded->after = *std::move(after);
  return RestoreFiles(loaded->record, loaded->finished);
}

absl::Status Coordinator::LoadRounds(LoadedJob* loaded) const {
  const ledger::JobRecord& record = loaded->record;
  if (!record.spec.has_adaptive()) return absl::OkStatus();
  for (const int32_t frame : loaded->frames) {
    if (std::binary_search(loaded->finished.begin(), loaded->finished.end(), frame)) continue;
    absl::StatusOr<job::FrameRounds> rounds = ReadRounds(folder_, record.id, record.spec, frame);
    if (absl::IsDataLoss(rounds.status())) {  // the same is estimated again, from the same units
      options_.log->error("event=rounds_damaged job={} frame={} error={}", record.id.value(), frame,
                          logging::Quoted(std::string(rounds.status().message())));
      if (absl::Status status = RemoveAll(folder_.RoundsPath(record.id, frame), folder_.files());
          !status.ok())
        return status;
      rounds = job::FrameRounds(record.spec);
    }
    if (!rounds.ok()) return rounds.status();
    loaded->rounds[frame] = std::make_shared<const job::FrameRounds>(*std::move(rounds));
  }
  return absl::OkStatus();
}

void Coordinator::EnterJob(const LoadedJob& loaded) {
  const JobId id = loaded.record.id;
  active_jobs_[id] = loaded.record;
  if (!loaded.error.empty()) return EndJob(id, v1::JOB_STATE_FAILED, loaded.error);
  scheduler::JobOptions options = scheduler::OptionsOf(loaded.record.scheduling);
  // The plan binds the job to its class before any unit does.
  const std::string& planned_class = loaded.record.spec.plan().numeric_class();
  if (!planned_class.empty()) options.numeric_class = planned_class;
  if (!loaded.record.numeric_class.empty()) options.numeric_class = loaded.record.numeric_class;
  scheduler_.AddJob(id, loaded.record.spec, options);
  LimitFramesFor(id);
  for (const int32_t frame : loaded.finished) scheduler_.RestoreFinishedFrame(id, frame);
  for (const auto& [frame, rounds] : loaded.rounds) {
    v1::StageTimes& times = active_jobs_.at(id).times;  // the ledger has those of finished frames
    times.set_render_seconds(std::max(times.render_seconds(), rounds->rendered_seconds()));
    scheduler_.SetRounds(id, frame, rounds);
  }
  for (const scheduler::RestoredUnit& unit : loaded.units)
    scheduler_.RestoreCommittedUnit(id, unit, options_.now());
  for (const int32_t frame : scheduler_.CommittedFrames(id)) QueueDue({id, frame});
  for (const auto& [frame, rounds] : loaded.rounds) QueueDue({id, frame});
  const scheduler::JobProgress progress = scheduler_.Progress(id);
  options_.log->info("event=job_restored job={} units={}/{} frames={}/{}", id.value(), progress.units_done,
                     progress.units_total, progress.frames_done, progress.frames_total);
  if (progress.frames_done == progress.frames_total) return EndJob(id, v1::JOB_STATE_DONE, "");
  // A job that has begun waited long enough, even if a job that it waited for runs again.
  const bool has_begun = progress.units_done > 0 || loaded.record.started != absl::InfinitePast();
  if (!has_begun) AwaitPrerequisites(id, loaded.after);
  GrantInHand();
}

absl::Status Coordinator::RestoreFiles(const ledger::JobRecord& record,
                                       const std::vector<int32_t>& finished) {
  const JobId& id = record.id;
  for (const int32_t frame : finished) janitor_.FrameFinished(id, frame);
  for (const int32_t frame : folder_.ResultsOf(id)) {
    // The result before the frame was reopened, or one that was written just before the last run ended.
    if (std::binary_search(finished.begin(), finished.end(), frame)) continue;
    RemoveAll(folder_.ResultPath(id, frame), folder_.files()).IgnoreError();  // it is written again
  }
  if (!absl::IsNotFound(ReadManifest(folder_.ManifestPath(id)).status())) return absl::OkStatus();
  // Submitted to a version without manifests. The ledger does not give the request id back.
  return WriteManifest(folder_, ManifestOf({.id = id,
                                            .request_id = absl::StrCat("of ", id.value()),
                                            .spec = record.spec,
                                            .scheduling = record.scheduling,
                                            .submitted = record.submitted,
                                            .owner = owner_}));
}

}  // namespace lumifold::server
