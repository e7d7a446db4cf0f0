#include "client/farm/download.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "proto/retry/storage_away.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/sha256.h"

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

std::string Name(const std::string& job_id, int frame) {
  return absl::StrCat("frame ", frame, " of job ", job_id);
}

// One try, from `offset` on. Opens the file when the first chunk arrives. Returns the SHA-256 that the
// coordinator states for the whole file.
absl::StatusOr<std::string> DownloadOnce(FarmClient& farm, const std::string& job_id, int frame,
                                         const std::string& part_path, uint64_t offset, Progress& progress) {
  std::string sha256;
  std::optional<rpc::ByteReceiver> receiver;
  const auto take = [&](const v1::ByteChunk& chunk) -> absl::Status {
    if (!receiver.has_value()) {
      absl::StatusOr<rpc::ByteReceiver> opened = rpc::ByteReceiver::Open(part_path, offset);
      if (!opened.ok()) return OfThisMachine(opened.status());
      receiver = std::move(*opened);
      sha256 = chunk.sha256();
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
    return absl::UnavailableError(absl::StrCat("the coordinator stopped sending ", Name(job_id, frame)));
  }
  if (absl::Status synced = receiver->Sync(); !synced.ok()) return OfThisMachine(synced);
  return sha256;
}

// Downloads the file from `offset` on, with retries. Returns the SHA-256 that the coordinator states. Sets
// *resumed where a part of the file is from an earlier try.
absl::StatusOr<std::string> DownloadFrom(FarmClient& farm, const std::string& job_id, int frame,
                                         const std::string& part_path, uint64_t offset, Progress& progress,
                                         Backoff& backoff, bool* resumed) {
  while (true) {
    *resumed = offset > 0;
    absl::StatusOr<std::string> sha256 = DownloadOnce(farm, job_id, frame, part_path, offset, progress);
    if (sha256.ok()) return sha256;
    if (absl::IsOutOfRange(sha256.status()) && offset > 0) {  // the part is longer than the result
      offset = 0;
      continue;
    }
    const bool may_retry = absl::IsUnavailable(sha256.status()) || absl::IsDataLoss(sha256.status());
    const uint64_t arrived = SizeOrZero(part_path);
    const bool has_progress = arrived > offset;
    // No byte ever arrived: a wrong address, not a broken connection.
    if (!may_retry) return sha256;
    if (!has_progress && arrived == 0 && !retry::IsStorageAway(sha256.status())) return sha256;
    if (has_progress) backoff.Reset();
    if (!backoff.Pause()) return sha256;
    offset = arrived;
  }
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
  std::string cause;
  // A second time where the first went on with bytes of an earlier try, which may be those that are wrong.
  for (bool resumed = true; resumed; offset = 0) {
    const bool is_last = !cause.empty();
    const absl::StatusOr<std::string> stated =
        DownloadFrom(farm, job_id, frame, part_path, offset, progress, backoff, &resumed);
    if (!stated.ok()) return stated.status();
    const absl::StatusOr<std::string> actual = rpc::Sha256HexOfFile(part_path);
    if (!actual.ok()) return OfThisMachine(actual.status());
    progress.Clear();
    if (*actual == *stated) return absl::OkStatus();
    cause = stated->empty() ? "the coordinator states no SHA-256"
                            : absl::StrCat("its SHA-256 is ", *actual, ", the coordinator states ", *stated);
    if (is_last || stated->empty()) break;
    if (resumed) progress.Message(absl::StrCat(Name(job_id, frame), ": ", cause, "; downloading it again"));
  }
  std::error_code ignored;  // the next call would find the same
  std::filesystem::remove(part_path, ignored);
  return absl::DataLossError(absl::StrCat(Name(job_id, frame), ": ", cause));
}

}  // namespace lumifold::client
