#include "server/assets/asset_store.h"

#include <fcntl.h>
#include <spdlog/logger.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "filter/image/file_calls.h"
#include "proto/logging/fields.h"

namespace lumifold::server {
namespace {

namespace fs = std::filesystem;

constexpr char kKeptSuffix[] = ".kept";
/// Suffix of the names of damaged assets.
constexpr char kDamagedSuffix[] = ".damaged";
/// Time between two records of an asset's use: short against kUnusedAssetAge, and long against a submission.
constexpr absl::Duration kUseInterval = absl::Hours(1);

/// Whether a file was last written longer ago than `age`. False where it cannot be read.
bool IsOlder(const fs::path& file, absl::Duration age) {
  std::error_code error;
  const fs::file_time_type written = fs::last_write_time(file, error);
  return !error &&
         written < fs::file_time_type::clock::now() - std::chrono::seconds(absl::ToInt64Seconds(age));
}

uint64_t SizeOrZero(const std::string& path) {
  std::error_code error;
  const auto size = fs::file_size(path, error);
  return error ? 0 : static_cast<uint64_t>(size);
}

std::string FullNameOf(const v1::AssetRef& asset) {
  return absl::StrCat("asset '", asset.uri(), "' (", asset.sha256(), ")");
}

// Removes kept uploads that are too old or too many. Errors are ignored, here and below: such an upload
// starts over.
void RemoveOldUploadsIn(const std::string& folder) {
  std::error_code error;
  std::vector<std::pair<fs::file_time_type, fs::path>> kept;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code gone;
    if (entry->path().extension() == kKeptSuffix)
      kept.emplace_back(fs::last_write_time(entry->path(), gone), entry->path());
  }
  std::sort(kept.rbegin(), kept.rend());
  for (size_t i = 0; i < kept.size(); ++i) {
    if (i >= kMaxKeptUploads || IsOlder(kept[i].second, kKeptUploadAge)) fs::remove(kept[i].second, error);
  }
}

// Gives the uploads that were running when a coordinator ended the name of kept ones, the longest of each
// asset. Those that were written less than `min_age` ago may be running at another coordinator.
void KeepUploads(const std::string& folder, absl::Duration min_age) {
  std::error_code error;
  std::vector<fs::path> files;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const bool is_over = min_age == absl::ZeroDuration() || IsOlder(entry->path(), min_age);
    if (entry->path().extension() != kKeptSuffix && is_over) files.push_back(entry->path());
  }
  for (const fs::path& file : files) {
    fs::path name = file;
    name.replace_extension(kKeptSuffix);
    const bool is_best = SizeOrZero(file) > SizeOrZero(name);
    if (is_best) fs::rename(file, name, error);
    if (!is_best || error) fs::remove_all(file, error);
  }
  RemoveOldUploadsIn(folder);
}

}  // namespace

AssetUpload::AssetUpload(v1::AssetRef asset, std::string caller, std::string incoming_path,
                         std::string kept_path, uint64_t expected_bytes, AssetStore* store)
    : asset_(std::move(asset)),
      caller_(std::move(caller)),
      incoming_path_(std::move(incoming_path)),
      kept_path_(std::move(kept_path)),
      store_(store),
      expected_bytes_(expected_bytes) {}

AssetUpload::~AssetUpload() {
  {
    absl::MutexLock lock(&store_->mutex_);
    store_->budget_.End(caller_, expected_bytes_);
  }
  if (!receiver_.has_value()) return;
  if (is_wrong_ || receiver_->offset() <= SizeOrZero(kept_path_)) {
    store_->files_->Remove(incoming_path_);
  } else {
    store_->files_->Rename(incoming_path_, kept_path_);
    RemoveOldUploadsIn(fs::path(kept_path_).parent_path());
  }
}

absl::Status AssetUpload::Error(absl::StatusCode code, const std::string& cause) const {
  return {code, absl::StrCat(FullNameOf(asset_), ": ", cause)};
}

absl::Status AssetUpload::ExpectFrom(uint64_t offset) {
  const uint64_t expected = asset_.size() - std::min(offset, asset_.size());
  const uint64_t room = store_->Room();
  absl::MutexLock lock(&store_->mutex_);
  if (expected > expected_bytes_) {
    absl::Status status =
        store_->budget_.Expect(caller_, FullNameOf(asset_), expected - expected_bytes_, room);
    if (!status.ok()) return status;
  } else {
    store_->budget_.Arrived(caller_, expected_bytes_ - expected);
  }
  expected_bytes_ = expected;
  return absl::OkStatus();
}

absl::Status AssetUpload::Start(uint64_t offset) {
  if (absl::Status status = ExpectFrom(offset); !status.ok()) return status;
  // The file is taken away from other uploads of the same asset by its new name.
  const bool is_gone = offset > 0 && (SizeOrZero(kept_path_) < offset ||
                                      store_->files_->Rename(kept_path_, incoming_path_) != 0);
  if (is_gone)
    return Error(absl::StatusCode::kAborted, absl::StrCat("the bytes before ", offset, " are gone"));
  absl::StatusOr<rpc::ByteReceiver> receiver =
      rpc::ByteReceiver::Open(incoming_path_, offset, store_->files_);
  if (!receiver.ok()) return receiver.status();
  receiver_ = *std::move(receiver);
  return offset > 0 ? rpc::AddFileStart(incoming_path_, offset, &sum_) : absl::OkStatus();
}

absl::Status AssetUpload::Add(const v1::ByteChunk& chunk) {
  if (chunk.total_size() != asset_.size()) {
    is_wrong_ = true;
    return Error(absl::StatusCode::kDataLoss,
                 absl::StrCat("its size is ", chunk.total_size(), ", announced were ", asset_.size()));
  }
  if (!receiver_.has_value()) {
    if (absl::Status status = Start(chunk.offset()); !status.ok()) return status;
  }
  if (absl::Status status = receiver_->Add(chunk); !status.ok()) return status;
  CountArrived(chunk.data().size());
  sum_.Update(chunk.data());
  return absl::OkStatus();
}

void AssetUpload::CountArrived(uint64_t bytes) {
  absl::MutexLock lock(&store_->mutex_);
  store_->budget_.Arrived(caller_, bytes);
  expected_bytes_ -= bytes;
}

absl::Status AssetUpload::Finish() {
  const uint64_t arrived = receiver_.has_value() ? receiver_->offset() : 0;
  if (!receiver_.has_value() || arrived != asset_.size()) {
    return Error(absl::StatusCode::kDataLoss,
                 absl::StrCat("only ", arrived, " of ", asset_.size(), " bytes arrived"));
  }
  if (sum_.FinishHex() != asset_.sha256()) {
    is_wrong_ = true;
    return Error(absl::StatusCode::kDataLoss, "the SHA-256 of its content is different");
  }
  if (absl::Status status = receiver_->Sync(); !status.ok()) return status;
  absl::Status installed = store_->Install(incoming_path_, asset_.sha256());
  if (!installed.ok()) return installed;
  receiver_.reset();
  store_->files_->Remove(kept_path_);  // of another upload of the same asset
  return absl::OkStatus();
}

AssetStore::AssetStore(std::string folder, std::string incoming_folder, std::shared_ptr<spdlog::logger> log,
                       FileSystem* files, const AssetLimits& limits)
    : folder_(std::move(folder)),
      incoming_folder_(std::move(incoming_folder)),
      log_(std::move(log)),
      files_(files),
      limits_(limits),
      budget_(limits.uploads) {
  KeepUploads(incoming_folder_, limits_.uploader.empty() ? absl::ZeroDuration() : kRunningUploadAge);
}

std::string AssetStore::KeptPathOf(const std::string& sha256) const {
  return absl::StrCat(incoming_folder_, "/", sha256, kKeptSuffix);
}

uint64_t AssetStore::ReceivedBytes(const std::string& sha256) const {
  return rpc::IsSha256Hex(sha256) ? SizeOrZero(KeptPathOf(sha256)) : 0;
}

absl::Status AssetStore::Check(const std::string& sha256) {
  if (!rpc::IsSha256Hex(sha256) || ::access(PathOf(sha256).c_str(), F_OK) != 0)
    return absl::NotFoundError(absl::StrCat("no asset ", sha256));
  {
    absl::MutexLock lock(&mutex_);
    AwaitCheck(sha256);
    RecordUse(sha256);
    if (!states_.try_emplace(sha256, State::kBeingChecked).second) return absl::OkStatus();
  }
  absl::Status content = CheckContent(sha256);
  if (absl::IsDataLoss(content)) content = MoveAside(sha256);
  absl::MutexLock lock(&mutex_);
  if (content.ok()) {
    states_[sha256] = State::kIntact;
  } else {
    states_.erase(sha256);  // the next caller looks again
  }
  return content;
}

bool AssetStore::NeedsCheck(const std::string& sha256) {
  if (!rpc::IsSha256Hex(sha256) || ::access(PathOf(sha256).c_str(), F_OK) != 0) return false;
  absl::MutexLock lock(&mutex_);
  const auto state = states_.find(sha256);
  return state == states_.end() || state->second == State::kBeingChecked;
}

void AssetStore::Invalidate(const std::string& sha256) {
  absl::MutexLock lock(&mutex_);
  const auto state = states_.find(sha256);
  if (state != states_.end() && state->second == State::kIntact) states_.erase(state);
}

uint64_t AssetStore::SizeOf(const std::string& sha256) const { return SizeOrZero(PathOf(sha256)); }

void AssetStore::AwaitCheck(const std::string& sha256) {
  const auto has_ended = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
    const auto state = states_.find(sha256);
    return state == states_.end() || state->second != State::kBeingChecked;
  };
  mutex_.Await(absl::Condition(&has_ended));
}

absl::Status AssetStore::CheckContent(const std::string& sha256) const {
  absl::StatusOr<rpc::ByteSender> file = rpc::ByteSender::Open(PathOf(sha256), 0);
  rpc::Sha256 sum;
  v1::ByteChunk chunk;
  while (file.ok()) {
    if (checks_stopped_) return absl::CancelledError("the coordinator is stopping");
    const absl::StatusOr<bool> has_more = file->Next(&chunk);
    if (!has_more.ok()) return has_more.status();
    if (!*has_more) break;
    sum.Update(chunk.data());
  }
  if (!file.ok()) return file.status();
  if (sum.FinishHex() == sha256) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("asset ", sha256, " is damaged"));
}

absl::Status AssetStore::MoveAside(const std::string& sha256) const {
  const std::string aside = PathOf(sha256) + kDamagedSuffix;
  if (const int error = files_->Rename(PathOf(sha256), aside); error != 0)
    return StorageError(PathOf(sha256), error);
  if (log_ != nullptr)
    log_->error("event=asset_damaged sha256={} moved_to={}", sha256, logging::Quoted(aside));
  return absl::NotFoundError(absl::StrCat("asset ", sha256,
                                          " was damaged on the disk of the coordinator and is moved aside;"
                                          " submit its scene again to upload it"));
}

absl::Status AssetStore::Install(const std::string& incoming_path, const std::string& sha256) {
  const std::string path = PathOf(sha256);
  {
    absl::MutexLock lock(&mutex_);
    // A check in progress may be about to move the old file aside.
    AwaitCheck(sha256);
    if (const int error = files_->Rename(incoming_path, path); error != 0) return StorageError(path, error);
    states_[sha256] = State::kIntact;
  }
  const int error = files_->SyncFolder(folder_);
  return error == 0 ? absl::OkStatus() : StorageError(folder_, error);
}

absl::StatusOr<std::unique_ptr<AssetUpload>> AssetStore::Receive(const v1::AssetRef& asset,
                                                                 const std::string& caller) {
  if (!rpc::IsSha256Hex(asset.sha256())) {
    return absl::InvalidArgumentError(
        absl::StrCat("asset '", asset.uri(), "': sha256 is not 64 lower-case hexadecimal digits"));
  }
  if (asset.size() > limits_.asset_bytes) {
    return absl::InvalidArgumentError(absl::StrCat("asset '", asset.uri(), "': its size is ", asset.size(),
                                                   ", more than ", limits_.asset_bytes));
  }
  const uint64_t room = Room();
  const uint64_t expected = asset.size() - std::min(asset.size(), ReceivedBytes(asset.sha256()));
  {
    absl::MutexLock lock(&mutex_);
    absl::Status status = budget_.Begin(caller, FullNameOf(asset), expected, room);
    if (!status.ok()) return status;
  }
  // Two clients may send the same asset at the same time, so each upload has its own file until it is
  // complete.
  std::string incoming =
      absl::StrCat(incoming_folder_, "/", asset.sha256(), ".", limits_.uploader, uploads_.fetch_add(1));
  return std::unique_ptr<AssetUpload>(
      new AssetUpload(asset, caller, std::move(incoming), KeptPathOf(asset.sha256()), expected, this));
}

absl::StatusOr<rpc::ByteSender> AssetStore::Open(const std::string& sha256, uint64_t offset) {
  if (absl::Status status = Check(sha256); !status.ok()) return status;
  return rpc::ByteSender::Open(PathOf(sha256), offset);
}

void AssetStore::RecordUse(const std::string& sha256) {
  // The time of the file, which outlives the coordinator. An asset whose time cannot be set is at worst sent
  // again.
  if (IsOlder(PathOf(sha256), kUseInterval)) utimensat(AT_FDCWD, PathOf(sha256).c_str(), nullptr, 0);
}

void AssetStore::RemoveOldUploads() const { RemoveOldUploadsIn(incoming_folder_); }

absl::Status AssetStore::RemoveUnused(absl::FunctionRef<absl::StatusOr<std::set<std::string>>()> referenced) {
  std::vector<fs::path> old;
  std::error_code error;
  for (fs::directory_iterator entry(folder_, error), end; !error && entry != end; entry.increment(error)) {
    if (IsOlder(entry->path(), kUnusedAssetAge)) old.push_back(entry->path());
  }
  if (old.empty()) return absl::OkStatus();
  const absl::StatusOr<std::set<std::string>> kept = referenced();
  if (!kept.ok()) return kept.status();
  for (const fs::path& file : old) {
    const std::string name = file.filename().string();
    const std::string sha256(absl::StripSuffix(name, kDamagedSuffix));
    if (!rpc::IsSha256Hex(sha256) || (name == sha256 && kept->contains(sha256))) continue;
    absl::MutexLock lock(&mutex_);
    AwaitCheck(sha256);
    if (!IsOlder(file, kUnusedAssetAge) || !fs::remove(file, error)) continue;  // it was used meanwhile
    if (name == sha256) states_.erase(sha256);
    if (log_ != nullptr) log_->info("event=asset_removed file={}", name);
  }
  return absl::OkStatus();
}

}  // namespace lumifold::server
