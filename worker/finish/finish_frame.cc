#include "worker/finish/finish_frame.h"

#include <fcntl.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <new>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "filter/image/parallel.h"
#include "filter/manifold/filter_device.h"
#include "lumifold/v1/rounds.pb.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/sha256.h"
#include "server/film/unit_log.h"
#include "server/film/unit_records.h"
#include "server/job/frame_rounds.h"
#include "server/picture/filtered_round.h"
#include "server/picture/make_picture.h"
#include "worker/finish/memory_files.h"
#include "worker/scene/out_of_memory.h"

namespace lumifold::worker {
namespace {

constexpr char kUnits[] = "units";
constexpr char kResult[] = "result";

absl::Status CheckWanted(const UnitControl& control) {
  return control.stop ? absl::CancelledError("the frame is no longer wanted") : absl::OkStatus();
}

/// What the coordinator sends of a frame.
struct FetchedFrame {
  film::UnitRecords units;
  film::LevelSet levels;
  std::optional<job::FrameRounds> rounds;  // with adaptive sampling
};

/// Takes the record of rounds off the end of the file with the units.
absl::StatusOr<job::FrameRounds> TakeRounds(const v1::JobSpec& spec, uint64_t units_bytes,
                                            uint64_t rounds_bytes, MemoryFiles* files) {
  const rpc::FileHandle file(files->Open(kUnits, O_RDWR));
  std::string bytes(rounds_bytes, '\0');
  const int64_t count = ReadAt(file.get(), units_bytes, bytes.data(), bytes.size());
  if (count < 0) return FileError(kUnits, count);
  v1::RoundEstimates rounds;
  if (static_cast<uint64_t>(count) < rounds_bytes || !rounds.ParseFromString(bytes))
    return absl::DataLossError("the record of the frame's rounds cannot be read");
  if (const int error = files->Truncate(file.get(), units_bytes); error != 0) return FileError(kUnits, error);
  return job::FrameRounds::Replay(spec, rounds);
}

absl::StatusOr<film::UnitRecords> OpenRecords(const v1::Lease& lease, rpc::FileHandle file) {
  absl::StatusOr<film::UnitLogReader> reader =
      film::UnitLogReader::OfFile(std::move(file), absl::StrCat("units of frame ", lease.unit().frame()));
  if (!reader.ok()) return reader.status();
  return film::UnitRecords::Open(*std::move(reader));
}

absl::StatusOr<FetchedFrame> Fetch(const v1::JobSpec& spec, const v1::Lease& lease, FrameLink* link,
                                   UnitControl* control, MemoryFiles* files) {
  film::LevelSet levels;
  uint64_t rounds_bytes = 0;
  absl::StatusOr<rpc::ByteReceiver> receiver = rpc::ByteReceiver::Open(kUnits, 0, files);
  if (!receiver.ok()) return receiver.status();
  absl::Status fetched = link->FetchUnits(lease, [&](const v1::ByteChunk& chunk) {
    ++control->progress;
    if (chunk.offset() == 0) {
      levels = film::LevelSet(chunk.film_levels());
      rounds_bytes = std::min(chunk.rounds_bytes(), chunk.total_size());
    }
    if (absl::Status status = CheckWanted(*control); !status.ok()) return status;
    return receiver->Add(chunk);
  });
  if (!fetched.ok()) return fetched;
  if (!receiver->IsComplete()) return absl::UnavailableError("the units of the frame ended early");
  std::optional<job::FrameRounds> rounds;
  if (spec.has_adaptive()) {
    absl::StatusOr<job::FrameRounds> taken =
        TakeRounds(spec, receiver->total_size() - rounds_bytes, rounds_bytes, files);
    if (!taken.ok()) return taken.status();
    rounds = *std::move(taken);
  }
  absl::StatusOr<film::UnitRecords> units = OpenRecords(lease, files->Take(kUnits));
  if (!units.ok()) return units.status();
  return FetchedFrame{*std::move(units), levels, std::move(rounds)};
}

/// The same of the units that the worker has kept.
absl::StatusOr<FetchedFrame> OpenKept(const v1::Lease& lease, rpc::FileHandle file) {
  absl::StatusOr<film::UnitRecords> units = OpenRecords(lease, std::move(file));
  if (!units.ok()) return units.status();
  return FetchedFrame{*std::move(units), {}, std::nullopt};
}

absl::StatusOr<std::string> Sha256Of(const rpc::FileHandle& file) {
  rpc::Sha256 sum;
  std::string bytes(size_t{1} << 20, '\0');
  for (uint64_t offset = 0;; offset += bytes.size()) {
    const int64_t count = ReadAt(file.get(), offset, bytes.data(), bytes.size());
    if (count < 0) return FileError(kResult, count);
    sum.Update(std::string_view(bytes).substr(0, static_cast<size_t>(count)));
    if (static_cast<size_t>(count) < bytes.size()) return sum.FinishHex();
  }
}

absl::StatusOr<std::string> FilterBlock(const server::CompleteFrame& frame, int block,
                                        const film::LevelSet& levels, TaskPool* pool) {
  if (block < 0 || block >= server::FrameBlocks(frame.spec).count())
    return absl::InvalidArgumentError("the frame has no such block");
  return server::MakeBlock(frame, block, levels, pool);
}

absl::StatusOr<std::string> EstimateRound(const server::CompleteFrame& frame, int round, TaskPool* pool) {
  if (frame.rounds == nullptr || round < 1 || round >= frame.rounds->count())
    return absl::InvalidArgumentError("the frame has no such round");
  const absl::StatusOr<std::vector<double>> errors =
      server::EstimateErrors(frame.spec, frame.frame, *frame.rounds, round, frame.units, pool);
  if (!errors.ok()) return errors.status();
  return server::BytesOfErrors(*errors);
}

/// What the coordinator makes a result of, as the file kResult.
absl::StatusOr<v1::FrameReport> MakePart(const server::CompleteFrame& frame, const v1::UnitId& unit,
                                         const film::LevelSet& levels, TaskPool* pool, MemoryFiles* files) {
  const absl::Time start = rpc::MonotonicNow();
  const absl::StatusOr<std::string> made = unit.kind() == v1::UNIT_KIND_BLOCK
                                               ? FilterBlock(frame, unit.tile(), levels, pool)
                                               : EstimateRound(frame, unit.pass(), pool);
  if (!made.ok()) return made.status();
  const rpc::FileHandle file(files->Open(kResult, O_RDWR | O_CREAT));
  if (file.get() < 0) return FileError(kResult, file.get());
  const std::string_view bytes = *made;
  if (const int error = files->Write(file.get(), 0, {bytes}); error != 0) return FileError(kResult, error);
  v1::FrameReport report;
  report.mutable_times()->set_filter_seconds(absl::ToDoubleSeconds(rpc::MonotonicNow() - start));
  return report;
}

absl::Status Finish(const v1::JobSpec& spec, const v1::Lease& lease, rpc::FileHandle kept,
                    const FrameWork& work, UnitControl* control) {
  const std::unique_ptr<TaskPool> pool = filter::WithDevice(MakeTaskPool(1), work.device);
  MemoryFiles files;
  const absl::StatusOr<FetchedFrame> fetched =
      kept.get() >= 0 ? OpenKept(lease, std::move(kept)) : Fetch(spec, lease, work.link, control, &files);
  if (!fetched.ok()) return fetched.status();
  const std::optional<job::FrameRounds>& rounds = fetched->rounds;
  const server::CompleteFrame frame = {.spec = spec,
                                       .frame = lease.unit().frame(),
                                       .numeric_class = work.numeric_class,
                                       .units = fetched->units,
                                       .rounds = rounds.has_value() ? &*rounds : nullptr,
                                       .progress = [control](double share) {
                                         ++control->progress;
                                         control->filtered = share;
                                       }};
  const absl::StatusOr<v1::FrameReport> report =
      lease.unit().kind() != v1::UNIT_KIND_RESULT
          ? MakePart(frame, lease.unit(), fetched->levels, pool.get(), &files)
          : server::MakePicture(
                frame,
                {.path = kResult, .files = &files, .may_commit = [&] { return CheckWanted(*control); }},
                pool.get(), rpc::MonotonicNow);
  if (!report.ok()) return report.status();
  ++control->progress;
  rpc::FileHandle result = files.Take(kResult);
  absl::StatusOr<std::string> sha256 = Sha256Of(result);
  if (!sha256.ok()) return sha256.status();
  absl::StatusOr<rpc::ByteSender> sender = rpc::ByteSender::OfFile(std::move(result), kResult, 0);
  if (!sender.ok()) return sender.status();
  sender->SetSha256(*std::move(sha256));
  return work.link->DeliverResult(lease, *report, [&](v1::ByteChunk* chunk) -> absl::StatusOr<bool> {
    ++control->progress;
    if (absl::Status status = CheckWanted(*control); !status.ok()) return status;
    return sender->Next(chunk);
  });
}

}  // namespace

absl::Status FinishFrame(const v1::JobSpec& spec, const v1::Lease& lease, rpc::FileHandle kept,
                         const FrameWork& work, UnitControl* control) {
  try {
    return Finish(spec, lease, std::move(kept), work, control);
  } catch (const std::bad_alloc&) {
    return scene::OutOfMemory("the frame");
  }
}

}  // namespace lumifold::worker
