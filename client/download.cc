#include "client/download.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "client/exit_code.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::client {
namespace {

uint64_t SizeOrZero(const std::string& path) {
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  return error ? 0 : static_cast<uint64_t>(size);
}

ProgressState Downloading(const rpc::ByteReceiver& receiver) {
  ProgressState state;
  state.stage = "downloading";
  state.unit = ProgressUnit::kBytes;
  state.done = static_cast<int64_t>(receiver.offset());
  state.total = static_cast<int64_t>(receiver.total_size());
  return state;
}

// One try, from `offset` on. Opens the file when the first chunk arrives.
absl::Status DownloadOnce(FarmClient& farm, const std::string& job_id, int frame,
                          const std::string& part_path, uint64_t offset, Progress& progress) {
  std::optional<rpc::ByteReceiver> receiver;
  const auto take = [&](const v1::ByteChunk& chunk) -> absl::Status {
    if (!receiver.has_value()) {
      absl::StatusOr<rpc::ByteReceiver> opened = rpc::ByteReceiver::Open(part_path, offset);
      if (!opened.ok()) return OfThisMachine(opened.status());
      receiver = std::move(*opened);
    }
    if (absl::Status added = receiver->Add(chunk); !added.ok()) {
      return absl::IsDataLoss(added) ? added : OfThisMachine(added);
    }
    progress.Update(Downloading(*receiver));
    return absl::OkStatus();
  };
  absl::Status status = farm.DownloadResult(job_id, frame, offset, take);
  if (!status.ok()) return status;
  if (!receiver.has_value() || !receiver->IsComplete()) {
    return absl::UnavailableError(
        absl::StrCat("the coordinator stopped sending frame ", frame, " of job ", job_id));
  }
  return OfThisMachine(receiver->Sync());
}

}  // namespace

absl::StatusOr<std::string> PartPath(const std::string& output, const std::string& job_id, int frame) {
  const bool plain = std::all_of(job_id.begin(), job_id.end(), [](unsigned char c) {
    return absl::ascii_isalnum(c) || c == '-' || c == '_';
  });
  if (!plain || job_id.empty()) return absl::NotFoundError(absl::StrCat("no job '", job_id, "'"));
  return absl::StrCat(output, ".", job_id, "-", frame, ".part");
}

absl::Status DownloadFrame(FarmClient& farm, const std::string& job_id, int frame,
                           const std::string& part_path, Progress& progress, Backoff backoff) {
  uint64_t offset = SizeOrZero(part_path);
  while (true) {
    absl::Status status = DownloadOnce(farm, job_id, frame, part_path, offset, progress);
    if (status.ok()) break;
    if (absl::IsOutOfRange(status) && offset > 0) {  // the part is longer than the result: start from 0
      offset = 0;
      continue;
    }
    const bool may_retry = absl::IsUnavailable(status) || absl::IsDataLoss(status);
    const uint64_t arrived = SizeOrZero(part_path);
    const bool has_progress = arrived > offset;
    // No byte ever arrived: a wrong address, not a broken connection.
    if (!may_retry || (!has_progress && arrived == 0)) return status;
    if (has_progress) backoff.Reset();
    if (!backoff.Pause()) return status;
    offset = arrived;
  }
  progress.Clear();
  return absl::OkStatus();
}

}  // namespace lumifold::client
