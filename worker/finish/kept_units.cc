#include "worker/finish/kept_units.h"

#include <fcntl.h>

#include <iterator>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "proto/rpc/rect_codec.h"
#include "server/film/stored_stats.h"
#include "server/film/unit_assembler.h"
#include "worker/units/unit_messages.h"

namespace lumifold::worker {

absl::StatusOr<film::EncodedUnit> RecordOf(const v1::JobSpec& spec, const v1::Lease& lease,
                                           const RenderedUnit& unit) {
  const SampleRange samples = {static_cast<uint32_t>(lease.first_sample()),
                               static_cast<uint32_t>(lease.last_sample())};
  film::UnitAssembler assembler(lease.unit().kind(), rpc::RectOf(lease.rect()), samples, film::ModelOf(spec));
  absl::Status status;
  SendUnit(lease, unit, [&](v1::WorkerMessage message) {
    if (status.ok()) status = assembler.Add(std::move(*message.mutable_chunk()));
  });
  if (!status.ok()) return status;
  return film::EncodeUnit(job::UnitFromProto(lease.unit()), job::Attempt(lease.attempt()),
                          film::StoredStats(unit.stats), assembler.Take());
}

std::string KeptUnits::PathOf(const Frame& frame) { return absl::StrCat(frame.first, "/", frame.second); }

absl::Status KeptUnits::Add(const film::EncodedUnit& unit) {
  const Frame frame = {unit.unit.job.value(), unit.unit.key.frame};
  auto log = logs_.find(frame);
  if (log == logs_.end()) {
    absl::StatusOr<film::UnitLog> opened = film::UnitLog::Open(PathOf(frame), 0, &files_);
    if (!opened.ok()) return opened.status();
    log = logs_.emplace(frame, *std::move(opened)).first;
  }
  return log->second.Append(unit).status();
}

absl::StatusOr<rpc::FileHandle> KeptUnits::Open(const v1::UnitId& unit) {
  const Frame frame = {unit.job_id(), unit.frame()};
  if (!logs_.contains(frame))
    return absl::FailedPreconditionError(absl::StrCat("the units of frame ", unit.frame(), " are not here"));
  rpc::FileHandle file(files_.Open(PathOf(frame), O_RDONLY));
  if (file.get() < 0) return FileError(PathOf(frame), file.get());
  return file;
}

void KeptUnits::Drop(const Frame& frame) {
  logs_.erase(frame);
  files_.Remove(PathOf(frame));
}

void KeptUnits::DropJob(const std::string& job_id) {
  for (auto log = logs_.lower_bound({job_id, 0}); log != logs_.end() && log->first.first == job_id;)
    Drop(Frame((log++)->first));
}

void KeptUnits::Clear() {
  while (!logs_.empty()) Drop(Frame(logs_.begin()->first));
}

}  // namespace lumifold::worker
