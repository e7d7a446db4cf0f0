#pragma once

#include <sys/types.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/file_system.h"
#include "worker/cache/asset_source.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::worker {

/// Makes the folder of an AssetFolder if it is missing, for `owner` alone: this process's user, or any where
/// that is root.
/// Errors: kFailedPrecondition naming it, where it is no folder, belongs to another user or can be written by
/// others; kUnavailable with the system's message.
absl::Status MakeAssetFolder(const std::string& path, uid_t owner);

struct AssetFolderOptions {
  std::string path;
  /// The least recently used assets go where there are more bytes than this.
  uint64_t max_bytes = uint64_t{20} << 30;
  /// Null: none.
  std::shared_ptr<spdlog::logger> log = nullptr;
  FileSystem* files = PrivateFileSystem();
};

/// Keeps assets in a folder of this machine that its workers share, and that outlives them: of many short
/// workers on a node one fetches a scene. A file is called by the SHA-256 of its content, and read again only
/// if it has it; so nothing in the folder has to be trusted, and a file that is cut short is fetched again.
/// The folder needs no lock: files are renamed into place, and removed at any time. It is a cache: what
/// cannot be written is not kept, and nothing fails for it.
/// Threads: safe concurrently, also with other processes.
class AssetFolder final : public AssetSource {
 public:
  /// `source` must outlive it.
  AssetFolder(AssetSource* source, AssetFolderOptions options)
      : source_(source), options_(std::move(options)) {}

  /// Errors: those of the source.
  absl::StatusOr<AssetContent> Fetch(const std::string& job_id, const v1::AssetRef& asset) override;

  /// Assets that were in the folder.
  int64_t hits() const { return hits_; }

 private:
  /// kNotFound where there is no such file, or not the right content.
  absl::StatusOr<AssetContent> Read(const v1::AssetRef& asset) const;
  absl::Status Write(const std::string& name, const std::string& content);
  /// Removes the least recently used assets until `bytes` more have room, and what interrupted writes have
  /// left.
  void MakeRoom(uint64_t bytes);

  AssetSource* const source_;
  const AssetFolderOptions options_;
  std::atomic<int64_t> hits_ = 0;
  absl::Mutex mutex_;  // one thread writes at a time
};

}  // namespace lumifold::worker
