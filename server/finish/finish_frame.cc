#include "server/finish/finish_frame.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "filter/image/file_io.h"
#include "server/commit/committed_units.h"
#include "server/film/result_digest.h"
#include "server/film/unit_film.h"
#include "server/finish/estimate_round.h"
#include "server/picture/make_picture.h"

namespace lumifold::server {

absl::StatusOr<v1::FrameReport> FinishFrame(const DataFolder& folder, ledger::JobStore& store,
                                            const ledger::OwnedJob& owned, int32_t frame, TaskPool* pool,
                                            const std::function<absl::Time()>& now,
                                            const filter::BlockParams& blocks, const std::vector<int>& ready,
                                            const FilterProgress& progress) {
  const job::JobId& job_id = owned.job;
  const absl::StatusOr<ledger::JobRecord> job = store.GetJob(job_id);
  if (!job.ok()) return job.status();
  const absl::StatusOr<CommittedUnits> units = CommittedUnits::Open(folder, store, *job, frame);
  if (!units.ok()) return units.status();
  std::optional<job::FrameRounds> rounds;
  if (job->spec.has_adaptive()) {
    absl::StatusOr<job::FrameRounds> read = ReadRounds(folder, job_id, job->spec, frame);
    if (!read.ok()) return read.status();
    rounds = *std::move(read);
  }
  if (absl::Status status = MakeFolder(folder.ResultsPath(job_id), folder.files()); !status.ok())
    return status;
  const std::string path = folder.ResultPath(job_id, frame);
  absl::StatusOr<v1::FrameReport> report = MakePicture(
      {.spec = job->spec,
       .frame = frame,
       .numeric_class = job->numeric_class,
       .units = *units,
       .rounds = rounds.has_value() ? &*rounds : nullptr,
       .ready_blocks = [&](int block) -> absl::StatusOr<std::optional<std::string>> {
         if (std::find(ready.begin(), ready.end(), block) == ready.end()) return std::nullopt;
         absl::StatusOr<std::string> bytes =
             ReadFile(folder.BlockPath(job_id, frame, block),
                      static_cast<int64_t>(FrameBlocks(job->spec, blocks).PictureBytes(block)));
         if (!bytes.ok()) return std::nullopt;  // it is made here
         return *std::move(bytes);
       },
       .progress = progress},
      {.path = path, .files = folder.files(), .may_commit = [&] { return CheckOwner(store, owned); }}, pool,
      now, blocks);
  if (!report.ok()) return report;
  const absl::StatusOr<std::string> digest = film::MakeResultDigest(path, folder.files());
  if (!digest.ok()) return digest.status();
  return report;
}

absl::StatusOr<v1::FrameReport> FilterBlock(const DataFolder& folder, ledger::JobStore& store,
                                            const ledger::OwnedJob& owned, int32_t frame, int block,
                                            TaskPool* pool, const std::function<absl::Time()>& now) {
  const absl::Time start = now();
  const absl::StatusOr<ledger::JobRecord> job = store.GetJob(owned.job);
  if (!job.ok()) return job.status();
  const absl::StatusOr<CommittedUnits> units = CommittedUnits::Open(folder, store, *job, frame);
  if (!units.ok()) return units.status();
  const absl::StatusOr<film::UnitFilm> film = film::UnitFilm::Open(job->spec, frame, &*units, pool);
  if (!film.ok()) return film.status();
  const absl::StatusOr<std::string> picture =
      MakeBlock({.spec = job->spec, .frame = frame, .numeric_class = job->numeric_class, .units = *units},
                block, film->levels(), pool);
  if (!picture.ok()) return picture.status();
  if (absl::Status status = MakeFolder(folder.ResultsPath(owned.job), folder.files()); !status.ok())
    return status;
  if (absl::Status status = CheckOwner(store, owned); !status.ok()) return status;
  const absl::Status written =
      WriteFileAtomically(folder.BlockPath(owned.job, frame, block), *picture, folder.files());
  if (!written.ok()) return written;
  v1::FrameReport report;
  report.mutable_times()->set_filter_seconds(absl::ToDoubleSeconds(now() - start));
  return report;
}

}  // namespace lumifold::server
