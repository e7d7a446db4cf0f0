#include "worker/finish/finish_frame.h"

#include <fcntl.h>

#include <algorithm>
#include <cstdint>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/sha256.h"
#include "server/film/unit_log.h"
#include "server/film/unit_records.h"
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

/// The records of the frame's units, as the coordinator sends them.
absl::StatusOr<film::UnitRecords> Fetch(const v1::Lease& lease, FrameLink* link, UnitControl* control,
                                        MemoryFiles* files, film::LevelSet* levels) {
  absl::StatusOr<rpc::ByteReceiver> receiver = rpc::ByteReceiver::Open(kUnits, 0, files);
  if (!receiver.ok()) return receiver.status();
  const absl::Status fetched = link->FetchUnits(lease, [&](const v1::ByteChunk& chunk) {
    ++control->progress;
    if (chunk.offset() == 0) *levels = film::LevelSet(chunk.film_levels());
    if (absl::Status status = CheckWanted(*control); !status.ok()) return status;
    return receiver->Add(chunk);
  });
  if (!fetched.ok()) return fetched;
  if (!receiver->IsComplete()) return absl::UnavailableError("the units of the frame ended early");
  absl::StatusOr<film::UnitLogReader> reader =
      film::UnitLogReader::OfFile(files->Take(kUnits), absl::StrCat("units of frame ", lease.unit().frame()));
  if (!reader.ok()) return reader.status();
  return film::UnitRecords::Open(*std::move(reader));
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

/// The picture of a block, as the file kResult.
absl::StatusOr<v1::FrameReport> FilterBlock(const server::CompleteFrame& frame, int block,
                                            const film::LevelSet& levels, MemoryFiles* files) {
  const absl::Time start = rpc::MonotonicNow();
  if (block < 0 || block >= server::FrameBlocks(frame.spec).count())
    return absl::InvalidArgumentError("the frame has no such block");
  const absl::StatusOr<std::string> picture = server::MakeBlock(frame, block, levels, /*pool=*/nullptr);
  if (!picture.ok()) return picture.status();
  const rpc::FileHandle file(files->Open(kResult, O_RDWR | O_CREAT));
  if (file.get() < 0) return FileError(kResult, file.get());
  const std::string_view bytes = *picture;
  if (const int error = files->Write(file.get(), 0, {bytes}); error != 0) return FileError(kResult, error);
  v1::FrameReport report;
  report.mutable_times()->set_filter_seconds(absl::ToDoubleSeconds(rpc::MonotonicNow() - start));
  return report;
}

absl::Status Finish(const v1::JobSpec& spec, const std::string& numeric_class, const v1::Lease& lease,
                    FrameLink* link, UnitControl* control) {
  MemoryFiles files;
  film::LevelSet levels;
  const absl::StatusOr<film::UnitRecords> units = Fetch(lease, link, control, &files, &levels);
  if (!units.ok()) return units.status();
  const server::CompleteFrame frame = {.spec = spec,
                                       .frame = lease.unit().frame(),
                                       .numeric_class = numeric_class,
                                       .units = *units,
                                       .progress = [control](double share) {
                                         ++control->progress;
                                         control->filtered = share;
                                       }};
  const absl::StatusOr<v1::FrameReport> report =
      lease.unit().kind() == v1::UNIT_KIND_BLOCK
          ? FilterBlock(frame, lease.unit().tile(), levels, &files)
          : server::MakePicture(
                frame,
                {.path = kResult, .files = &files, .may_commit = [&] { return CheckWanted(*control); }},
                /*pool=*/nullptr, rpc::MonotonicNow);
  if (!report.ok()) return report.status();
  ++control->progress;
  rpc::FileHandle result = files.Take(kResult);
  absl::StatusOr<std::string> sha256 = Sha256Of(result);
  if (!sha256.ok()) return sha256.status();
  absl::StatusOr<rpc::ByteSender> sender = rpc::ByteSender::OfFile(std::move(result), kResult, 0);
  if (!sender.ok()) return sender.status();
  sender->SetSha256(*std::move(sha256));
  return link->DeliverResult(lease, report->times(), [&](v1::ByteChunk* chunk) -> absl::StatusOr<bool> {
    ++control->progress;
    if (absl::Status status = CheckWanted(*control); !status.ok()) return status;
    return sender->Next(chunk);
  });
}

}  // namespace

absl::Status FinishFrame(const v1::JobSpec& spec, const std::string& numeric_class, const v1::Lease& lease,
                         FrameLink* link, UnitControl* control) {
  try {
    return Finish(spec, numeric_class, lease, link, control);
  } catch (const std::bad_alloc&) {
    return scene::OutOfMemory("the frame");
  }
}

}  // namespace lumifold::worker
