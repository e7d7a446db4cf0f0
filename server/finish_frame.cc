#include "server/finish_frame.h"

#include <array>
#include <map>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/exr_io.h"
#include "filter/methods.h"
#include "server/film/assemble.h"
#include "server/film/result.h"
#include "server/film/unit_log.h"
#include "server/scheduler/tile_grid.h"

namespace lumifold::server {
namespace {

using ledger::JobRecord;
using ledger::UnitRecord;
using scheduler::UnitKey;
using scheduler::UnitRef;

/// A frame's merged units: finds the ledger's row of a unit and reads its record. Threads: safe.
class MergedUnits {
 public:
  static absl::StatusOr<MergedUnits> Open(const DataFolder& folder, const JobRecord& job,
                                          std::vector<UnitRecord> records);
  absl::StatusOr<EdgedImage> Read(const UnitKey& key) const;

 private:
  explicit MergedUnits(const v1::JobSpec& spec) : units_(spec), rows_(static_cast<size_t>(units_.count())) {}

  scheduler::FrameUnits units_;
  std::vector<UnitRecord> records_;
  std::vector<const UnitRecord*> rows_;  // by number within the frame
  std::map<std::string, film::UnitLogReader> logs_;
};

absl::StatusOr<MergedUnits> MergedUnits::Open(const DataFolder& folder, const JobRecord& job,
                                              std::vector<UnitRecord> records) {
  MergedUnits merged(job.spec);
  merged.records_ = std::move(records);
  for (const UnitRecord& record : merged.records_) {
    const std::optional<int64_t> number = merged.units_.NumberOf(record.unit.key);
    if (!number.has_value()) {
      return absl::DataLossError(absl::StrCat("ledger: the job has no unit ", Describe(record.unit)));
    }
    merged.rows_[static_cast<size_t>(*number)] = &record;
    if (merged.logs_.contains(record.file)) continue;
    absl::StatusOr<film::UnitLogReader> log = film::UnitLogReader::Open(folder.PathOf(record.file));
    if (!log.ok()) return log.status();
    merged.logs_.emplace(record.file, *std::move(log));
  }
  return merged;
}

absl::StatusOr<EdgedImage> MergedUnits::Read(const UnitKey& key) const {
  const UnitRecord* row = rows_[static_cast<size_t>(*units_.NumberOf(key))];
  if (row == nullptr)
    return absl::DataLossError(absl::StrCat("ledger: tile ", key.tile, " is not merged whole"));
  absl::StatusOr<film::StoredUnit> stored = logs_.at(row->file).Read({row->offset, row->length});
  if (!stored.ok()) return stored.status();
  if (stored->unit != row->unit) {
    return absl::DataLossError(absl::StrCat(row->file, ": record at ", row->offset, " is of ",
                                            Describe(stored->unit), ", not of ", Describe(row->unit)));
  }
  return std::move(stored->image);
}

absl::StatusOr<EdgedImage> ReadFilm(const DataFolder& folder, ledger::JobStore& store, const JobRecord& job,
                                    int32_t frame, TaskPool* pool) {
  absl::StatusOr<std::vector<UnitRecord>> records = store.FrameUnits(job.id, frame);
  if (!records.ok()) return records.status();
  const absl::StatusOr<MergedUnits> units = MergedUnits::Open(folder, job, *std::move(records));
  if (!units.ok()) return units.status();
  return film::AssembleFilm(
      job.spec, frame, [&units](const UnitKey& key) { return units->Read(key); }, pool);
}

}  // namespace

absl::StatusOr<v1::StageTimes> FinishFrame(const DataFolder& folder, ledger::JobStore& store,
                                           const scheduler::JobId& job_id, int32_t frame, TaskPool* pool,
                                           const std::function<absl::Time()>& now) {
  const absl::StatusOr<JobRecord> job = store.GetJob(job_id);
  if (!job.ok()) return job.status();
  v1::StageTimes times;
  const absl::Time start = now();
  absl::StatusOr<EdgedImage> film = ReadFilm(folder, store, *job, frame, pool);
  if (!film.ok()) return film.status();
  const absl::Time assembled = now();
  absl::StatusOr<std::array<Plane, 3>> filtered =
      filter::FilterFilm(film->pixels, job->spec.filter().method(), pool, &film->edges);
  if (!filtered.ok()) return filtered.status();
  const absl::Time filtered_at = now();
  const EdgedImage result =
      film::BuildResult(*std::move(film), *std::move(filtered),
                        {.spec = job->spec, .frame = frame, .numeric_class = job->numeric_class});
  if (absl::Status status = MakeFolder(folder.ResultsPath(job_id)); !status.ok()) return status;
  if (absl::Status status = WriteExr(folder.ResultPath(job_id, frame), result); !status.ok()) return status;
  times.set_assemble_seconds(absl::ToDoubleSeconds(assembled - start));
  times.set_filter_seconds(absl::ToDoubleSeconds(filtered_at - assembled));
  times.set_write_seconds(absl::ToDoubleSeconds(now() - filtered_at));
  return times;
}

}  // namespace lumifold::server
