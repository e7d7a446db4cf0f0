#include "server/asset_store.h"

#include <fcntl.h>
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
                         std::string final_path)
    : asset_(std::move(asset)),
      incoming_path_(std::move(incoming_path)),
      kept_path_(std::move(kept_path)),
      final_path_(std::move(final_path)) {}

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
  if (std::rename(incoming_path_.c_str(), final_path_.c_str()) != 0) {
    return absl::UnavailableError(absl::StrCat(final_path_, ": ", std::strerror(errno)));
  }
  receiver_.reset();
  unlink(kept_path_.c_str());  // of another upload of the same asset
  return SyncFolder(final_path_.substr(0, final_path_.rfind('/')));
}

AssetStore::AssetStore(std::string folder, std::string incoming_folder)
    : folder_(std::move(folder)), incoming_folder_(std::move(incoming_folder)) {
  KeepUploads(incoming_folder_);
}

std::string AssetStore::KeptPathOf(const std::string& sha256) const {
  return absl::StrCat(incoming_folder_, "/", sha256, kKeptSuffix);
}

uint64_t AssetStore::ReceivedBytes(const std::string& sha256) const {
  return rpc::IsSha256Hex(sha256) ? SizeOrZero(KeptPathOf(sha256)) : 0;
}

bool AssetStore::Has(const std::string& sha256) const {
  return rpc::IsSha256Hex(sha256) && access(PathOf(sha256).c_str(), R_OK) == 0;
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
      new AssetUpload(asset, std::move(incoming), KeptPathOf(asset.sha256()), PathOf(asset.sha256())));
}

absl::StatusOr<rpc::ByteSender> AssetStore::Open(const std::string& sha256, uint64_t offset) const {
  if (!Has(sha256)) return absl::NotFoundError(absl::StrCat("no asset ", sha256));
  return rpc::ByteSender::Open(PathOf(sha256), offset);
}

}  // namespace lumifold::server
