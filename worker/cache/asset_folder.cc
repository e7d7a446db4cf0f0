#include "worker/cache/asset_folder.h"

#include <fcntl.h>
#include <spdlog/logger.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "filter/image/file_calls.h"
#include "proto/logging/fields.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/sha256.h"

namespace lumifold::worker {
namespace {

namespace fs = std::filesystem;

constexpr absl::string_view kPartial = ".partial";
/// A write that takes longer was interrupted.
constexpr std::chrono::hours kLongestWrite(1);

struct StoredAsset {
  fs::path path;
  uint64_t bytes = 0;
  fs::file_time_type used;
};

}  // namespace

absl::Status MakeAssetFolder(const std::string& path, uid_t owner) {
  constexpr mode_t kOwnerOnly = 0700;
  const bool is_new = mkdir(path.c_str(), kOwnerOnly) == 0;
  if (!is_new && errno != EEXIST) return StorageError(path, errno);
  // A folder that was there is never given away.
  if (is_new && owner != geteuid() && chown(path.c_str(), owner, static_cast<gid_t>(-1)) != 0)
    return StorageError(path, errno);
  struct stat info = {};
  if (lstat(path.c_str(), &info) != 0) return StorageError(path, errno);
  if (!S_ISDIR(info.st_mode)) return absl::FailedPreconditionError(absl::StrCat(path, " is not a folder"));
  if (info.st_uid != owner)
    return absl::FailedPreconditionError(absl::StrCat(path, " belongs to another user"));
  if ((info.st_mode & (S_IWGRP | S_IWOTH)) != 0)
    return absl::FailedPreconditionError(absl::StrCat(path, " can be written by others"));
  return absl::OkStatus();
}

absl::StatusOr<AssetContent> AssetFolder::Fetch(const std::string& job_id, const v1::AssetRef& asset) {
  if (!rpc::IsSha256Hex(asset.sha256())) return source_->Fetch(job_id, asset);
  absl::StatusOr<AssetContent> content = Read(asset);
  if (content.ok()) {
    ++hits_;
    return content;
  }
  content = source_->Fetch(job_id, asset);
  if (!content.ok() || (*content)->size() > options_.max_bytes) return content;
  const absl::MutexLock lock(&mutex_);
  MakeRoom((*content)->size());
  const absl::Status written = Write(asset.sha256(), **content);
  if (!written.ok() && options_.log != nullptr)
    options_.log->warn("event=asset_not_kept sha256={} error={}", asset.sha256(),
                       logging::Quoted(written.message()));
  return content;
}

absl::StatusOr<AssetContent> AssetFolder::Read(const v1::AssetRef& asset) const {
  const fs::path path = fs::path(options_.path) / asset.sha256();
  std::error_code error;
  if (fs::file_size(path, error) != asset.size() || error) return absl::NotFoundError("not in the folder");
  std::ifstream file(path, std::ios::binary);
  std::string content(static_cast<size_t>(asset.size()), '\0');
  file.read(content.data(), static_cast<std::streamsize>(content.size()));
  if (!file || rpc::Sha256Hex(content) != asset.sha256()) return absl::NotFoundError("not in the folder");
  fs::last_write_time(path, fs::file_time_type::clock::now(), error);  // unless it is removed meanwhile
  if (options_.log != nullptr) options_.log->debug("event=asset_found sha256={}", asset.sha256());
  return std::make_shared<const std::string>(std::move(content));
}

absl::Status AssetFolder::Write(const std::string& name, const std::string& content) {
  const std::string path = absl::StrCat(options_.path, "/", name);
  const std::string partial = absl::StrCat(path, ".", getpid(), kPartial);
  FileSystem& files = *options_.files;
  const rpc::FileHandle file(files.Open(partial, O_WRONLY | O_CREAT | O_TRUNC));
  if (file.get() < 0) return StorageError(partial, file.get());
  const std::string_view pieces[] = {content};
  int result = files.Write(file.get(), 0, pieces);
  if (result >= 0) result = files.Rename(partial, path);
  if (result >= 0) return absl::OkStatus();
  files.Remove(partial);
  return StorageError(path, result);
}

void AssetFolder::MakeRoom(uint64_t bytes) {
  std::vector<StoredAsset> assets;
  uint64_t sum = bytes;
  std::error_code error;
  for (fs::directory_iterator entry(options_.path, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code gone;  // removed meanwhile
    const StoredAsset asset = {entry->path(), entry->file_size(gone), entry->last_write_time(gone)};
    if (gone) continue;
    const std::string name = asset.path.filename();
    const bool is_left =
        absl::EndsWith(name, kPartial) && fs::file_time_type::clock::now() - asset.used > kLongestWrite;
    if (is_left) options_.files->Remove(asset.path);
    if (!rpc::IsSha256Hex(name)) continue;  // not ours, or being written
    assets.push_back(asset);
    sum += asset.bytes;
  }
  std::sort(assets.begin(), assets.end(),
            [](const StoredAsset& a, const StoredAsset& b) { return a.used < b.used; });
  for (const StoredAsset& asset : assets) {
    if (sum <= options_.max_bytes) return;
    options_.files->Remove(asset.path);
    sum -= asset.bytes;
  }
}

}  // namespace lumifold::worker
