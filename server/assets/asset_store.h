#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "filter/image/file_system.h"
#include "lumifold/v1/image.pb.h"
#include "lumifold/v1/scene.pb.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/sha256.h"
#include "server/assets/upload_budget.h"
#include "server/job/limits.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

/// Uploads that broke are kept for this long and in this number, the newest; a client that goes on with one
/// that is gone starts over.
inline constexpr absl::Duration kKeptUploadAge = absl::Hours(24);
inline constexpr size_t kMaxKeptUploads = 64;

/// An upload at another coordinator may be running while its file was written less than this ago; it ends
/// when nothing comes for a shorter time.
inline constexpr absl::Duration kRunningUploadAge = absl::Minutes(10);

/// An asset that no job refers to is removed when it was not used for this long.
inline constexpr absl::Duration kUnusedAssetAge = absl::Hours(7 * 24);

struct AssetLimits {
  /// Of one asset; at most job::kMaxAssetBytes.
  uint64_t asset_bytes = job::kMaxAssetBytes;
  UploadLimits uploads = {};
  /// Where other coordinators use the same folders: a name that none of them has. Empty: the only one.
  std::string uploader = {};
};

class AssetStore;

/// An asset that is being received. If it ends before Finish succeeds, what has arrived is kept for a later
/// upload, unless it does not match what was announced.
/// Threads: one at a time.
class AssetUpload {
 public:
  ~AssetUpload();
  AssetUpload(const AssetUpload&) = delete;
  AssetUpload& operator=(const AssetUpload&) = delete;

  /// Adds the next piece. The first may begin where an earlier upload of the asset broke (see
  /// AssetStore::ReceivedBytes).
  /// Errors: as ByteReceiver::Add; kDataLoss where the size is not the announced one; kAborted where the
  /// bytes before the first piece are no longer kept; kResourceExhausted where there is no room for the bytes
  /// that are to come.
  absl::Status Add(const v1::ByteChunk& chunk);

  /// Stores the asset.
  /// Errors: kDataLoss naming it when size or SHA-256 are not the announced ones; kUnavailable for a disk
  /// error.
  absl::Status Finish();

 private:
  friend class AssetStore;
  AssetUpload(v1::AssetRef asset, std::string caller, std::string incoming_path, std::string kept_path,
              uint64_t expected_bytes, AssetStore* store);
  absl::Status Start(uint64_t offset);
  /// The upload begins at `offset`: what is to come is not what was announced.
  absl::Status ExpectFrom(uint64_t offset);
  void CountArrived(uint64_t bytes);
  absl::Status Error(absl::StatusCode code, const std::string& cause) const;

  const v1::AssetRef asset_;
  const std::string caller_;
  const std::string incoming_path_;
  const std::string kept_path_;
  AssetStore* const store_;
  std::optional<rpc::ByteReceiver> receiver_;  // from the first piece on
  rpc::Sha256 sum_;
  bool is_wrong_ = false;    // does not match what was announced: not kept
  uint64_t expected_bytes_;  // of the store's budget
};

/// Files identified by their SHA-256. A stored file is complete; whether the disk has kept its content is
/// checked when it is first used after the start, by reading all of it. A damaged file is renamed to
/// SHA256.damaged and counts as missing, so that the next upload replaces it. Callers that need an asset
/// while it is being checked wait for the result.
/// Threads: safe.
class AssetStore {
 public:
  /// Both folders exist and are on the same file system. Keeps the uploads that a killed coordinator left in
  /// `incoming_folder`, within the limits above. `log`, if not null, is told of damaged assets. `files` must
  /// outlive it.
  AssetStore(std::string folder, std::string incoming_folder, std::shared_ptr<spdlog::logger> log = nullptr,
             FileSystem* files = PrivateFileSystem(), const AssetLimits& limits = {});

  /// Sets what returns the bytes that uploads may take at a moment; without it there is no limit. Call it
  /// before any upload.
  void SetRoom(std::function<uint64_t()> room) { room_ = std::move(room); }

  /// Whether the asset is stored and undamaged. False for text that is not a SHA-256.
  bool Has(const std::string& sha256) { return Check(sha256).ok(); }

  /// Whether the asset is stored and Has would have to read it, or wait for that.
  bool NeedsCheck(const std::string& sha256);
  /// The content of the asset may have changed since it was checked: it counts as not checked.
  void Invalidate(const std::string& sha256);
  /// Ends checks in progress, with kCancelled; further ones end at once.
  void StopChecks() { checks_stopped_ = true; }
  /// 0 for an asset that is not stored.
  uint64_t SizeOf(const std::string& sha256) const;

  /// How many bytes of an asset are kept from an upload that broke; 0 for none.
  uint64_t ReceivedBytes(const std::string& sha256) const;

  /// Begins to receive an asset from a caller, see UploadBudget. The store must outlive the upload.
  /// Errors: kInvalidArgument where `asset` has no valid SHA-256 or is larger than the limit;
  /// kResourceExhausted where too many uploads, or too many bytes, are announced; kUnavailable for a disk
  /// error.
  absl::StatusOr<std::unique_ptr<AssetUpload>> Receive(const v1::AssetRef& asset, const std::string& caller);

  /// Reads an asset from `offset` on.
  /// Errors: kNotFound naming it, also where it is damaged; kOutOfRange past its end; kUnavailable where it
  /// cannot be read.
  absl::StatusOr<rpc::ByteSender> Open(const std::string& sha256, uint64_t offset);

  /// Removes what is left of uploads that broke too long ago, see kKeptUploadAge.
  void RemoveOldUploads() const;
  /// Removes the assets that were not used for kUnusedAssetAge and to which no job refers, and the damaged
  /// ones of that age. `referenced` returns the SHA-256 of the others; it is called only where there are
  /// assets of that age. One that is used after that call stays. Errors: those of `referenced`.
  absl::Status RemoveUnused(absl::FunctionRef<absl::StatusOr<std::set<std::string>>()> referenced);

 private:
  friend class AssetUpload;
  enum class State { kBeingChecked, kIntact };

  /// Checks the asset unless that has been done since the start.
  absl::Status Check(const std::string& sha256);
  /// Waits until the asset is not being checked.
  void AwaitCheck(const std::string& sha256) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Reads the whole asset. Errors: kNotFound; kDataLoss where its content has another SHA-256; kUnavailable.
  absl::Status CheckContent(const std::string& sha256) const;
  /// Moves a damaged asset aside.
  absl::Status MoveAside(const std::string& sha256) const;
  /// Remembers on the disk that the asset was used now, at most once in kUseInterval.
  void RecordUse(const std::string& sha256) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Makes a received file, whose content is right, the stored asset.
  absl::Status Install(const std::string& incoming_path, const std::string& sha256);

  /// The bytes that uploads may take at this moment.
  uint64_t Room() const { return room_ == nullptr ? std::numeric_limits<uint64_t>::max() : room_(); }
  std::string PathOf(const std::string& sha256) const { return folder_ + "/" + sha256; }
  std::string KeptPathOf(const std::string& sha256) const;

  const std::string folder_;
  const std::string incoming_folder_;
  const std::shared_ptr<spdlog::logger> log_;
  FileSystem* const files_;
  const AssetLimits limits_;
  std::function<uint64_t()> room_;
  std::atomic<int64_t> uploads_{0};
  std::atomic<bool> checks_stopped_{false};

  absl::Mutex mutex_;
  std::map<std::string, State> states_ ABSL_GUARDED_BY(mutex_);  // assets used since the start
  UploadBudget budget_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::server
