#include "server/asset_store.h"

#include <fcntl.h>
#include <spdlog/logger.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace lumifold::server {
namespace {

namespace fs = std::filesystem;

constexpr char kKeptSuffix[] = ".kept";
/// Suffix of the names of damaged assets.
constexpr char kDamagedSuffix[] = ".damaged";

absl::Status SyncFolder(const std::string& folder) {
  const rpc::FileHandle handle(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (handle.get() >= 0 && fsync(handle.get()) == 0) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(folder, ": ", std::strerror(errno)));
}

uint64_t SizeOrZero(const std::string& path) {
  std::error_code error;
  const auto size = fs::file_size(path, error);
  return error ? 0 : static_cast<uint64_t>(size);
}

// Removes kept uploads that are too old or too many. Errors are ignored, here and below: such an upload starts
// over.
void RemoveOldUploads(const std::string& folder) {
  std::error_code error;
  std::vector<std::pair<fs::file_time_type, fs::path>> kept;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code gone;
    if (entry->path().extension() == kKeptSuffix)
      kept.emplace_back(fs::last_write_time(entry->path(), gone), entry->path());
  }
  const fs::file_time_type oldest =
      fs::file_time_type::clock::now() - std::chrono::seconds(absl::ToInt64Seconds(kKeptUploadAge));
  std::sort(kept.rbegin(), kept.rend());
  for (size_t i = 0; i < kept.size(); ++i) {
    if (i >= kMaxKeptUploads || kept[i].first < oldest) fs::remove(kept[i].second, error);
  }
}

// Gives the uploads that were running when a coordinator ended the name of kept ones, the longest of each
// asset.
void KeepUploads(const std::string& folder) {
  std::error_code error;
  std::vector<fs::path> files;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (entry->path().extension() != kKeptSuffix) files.push_back(entry->path());
  }
  for (const fs::path& file : files) {
    fs::path name = file;
    name.replace_extension(kKeptSuffix);
    const bool is_best = SizeOrZero(file) > SizeOrZero(name);
    if (is_best) fs::rename(file, name, error);
    if (!is_best || error) fs::remove_all(file, error);
  }
  RemoveOldUploads(folder);
}

}  // namespace

AssetUpload::AssetUpload(v1::AssetRef asset, std::string incoming_path, std::string kept_path,
                         AssetStore* store)
    : asset_(std::move(asset)),
      incoming_path_(std::move(incoming_path)),
      kept_path_(std::move(kept_path)),
      store_(store) {}

AssetUpload::~AssetUpload() {
  if (!receiver_.has_value()) return;
  if (is_wrong_ || receiver_->offset() <= SizeOrZero(kept_path_)) {
    unlink(incoming_path_.c_str());
  } else {
    std::rename(incoming_path_.c_str(), kept_path_.c_str());
    RemoveOldUploads(fs::path(kept_path_).parent_path());
  }
}

absl::Status AssetUpload::Error(absl::StatusCode code, const std::string& cause) const {
  return {code, absl::StrCat("asset '", asset_.uri(), "' (", asset_.sha256(), "): ", cause)};
}

absl::Status AssetUpload::Start(uint64_t offset) {
  // The file is taken away from other uploads of the same asset by its new name.
  const bool is_gone = offset > 0 && (SizeOrZero(kept_path_) < offset ||
                                      std::rename(kept_path_.c_str(), incoming_path_.c_str()) != 0);
  if (is_gone)
    return Error(absl::StatusCode::kAborted, absl::StrCat("the bytes before ", offset, " are gone"));
  absl::StatusOr<rpc::ByteReceiver> receiver = rpc::ByteReceiver::Open(incoming_path_, offset);
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
  sum_.Update(chunk.data());
  return absl::OkStatus();
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
  unlink(kept_path_.c_str());  // of another upload of the same asset
  return absl::OkStatus();
}

AssetStore::AssetStore(std::string folder, std::string incoming_folder, std::shared_ptr<spdlog::logger> log)
    : folder_(std::move(folder)), incoming_folder_(std::move(incoming_folder)), log_(std::move(log)) {
  KeepUploads(incoming_folder_);
}

std::string AssetStore::KeptPathOf(const std::string& sha256) const {
  return absl::StrCat(incoming_folder_, "/", sha256, kKeptSuffix);
}

uint64_t AssetStore::ReceivedBytes(const std::string& sha256) const {
  return rpc::IsSha256Hex(sha256) ? SizeOrZero(KeptPathOf(sha256)) : 0;
}

absl::Status AssetStore::Check(const std::string& sha256) {
  const absl::Status missing = absl::NotFoundError(absl::StrCat("no asset ", sha256));
  if (!rpc::IsSha256Hex(sha256) || access(PathOf(sha256).c_str(), F_OK) != 0) return missing;
  {
    absl::MutexLock lock(&mutex_);
    AwaitCheck(sha256);
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
  if (std::rename(PathOf(sha256).c_str(), aside.c_str()) != 0)
    return absl::UnavailableError(absl::StrCat(PathOf(sha256), ": ", std::strerror(errno)));
  if (log_ != nullptr) log_->error("event=asset_damaged sha256={} moved_to=\"{}\"", sha256, aside);
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
    if (std::rename(incoming_path.c_str(), path.c_str()) != 0)
      return absl::UnavailableError(absl::StrCat(path, ": ", std::strerror(errno)));
    states_[sha256] = State::kIntact;
  }
  return SyncFolder(folder_);
}

absl::StatusOr<std::unique_ptr<AssetUpload>> AssetStore::Receive(const v1::AssetRef& asset) {
  if (!rpc::IsSha256Hex(asset.sha256())) {
    return absl::InvalidArgumentError(
        absl::StrCat("asset '", asset.uri(), "': sha256 is not 64 lower-case hexadecimal digits"));
  }
  // Two clients may send the same asset at the same time, so each upload has its own file until it is
  // complete.
  std::string incoming = absl::StrCat(incoming_folder_, "/", asset.sha256(), ".", uploads_.fetch_add(1));
  return std::unique_ptr<AssetUpload>(
      new AssetUpload(asset, std::move(incoming), KeptPathOf(asset.sha256()), this));
}

absl::StatusOr<rpc::ByteSender> AssetStore::Open(const std::string& sha256, uint64_t offset) {
  if (absl::Status status = Check(sha256); !status.ok()) return status;
  return rpc::ByteSender::Open(PathOf(sha256), offset);
}

}  // namespace lumifold::server
