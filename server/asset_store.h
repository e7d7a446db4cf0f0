#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "lumifold/v1/image.pb.h"
#include "lumifold/v1/scene.pb.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/sha256.h"

namespace lumifold::server {

/// Uploads that broke are kept for this long and in this number, the newest; a client that goes on with one
/// that is gone starts over.
inline constexpr absl::Duration kKeptUploadAge = absl::Hours(24);
inline constexpr size_t kMaxKeptUploads = 64;

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
  /// Errors: as ByteReceiver::Add; kDataLoss where the size is not the announced one; kAborted where the bytes
  /// before the first piece are no longer kept.
  absl::Status Add(const v1::ByteChunk& chunk);

  /// Stores the asset.
  /// Errors: kDataLoss naming it when size or SHA-256 are not the announced ones; kUnavailable for a disk
  /// error.
  absl::Status Finish();

 private:
  friend class AssetStore;
  AssetUpload(v1::AssetRef asset, std::string incoming_path, std::string kept_path, std::string final_path);
  absl::Status Start(uint64_t offset);
  absl::Status Error(absl::StatusCode code, const std::string& cause) const;

  const v1::AssetRef asset_;
  const std::string incoming_path_;
  const std::string kept_path_;
  const std::string final_path_;
  std::optional<rpc::ByteReceiver> receiver_;  // from the first piece on
  rpc::Sha256 sum_;
  bool is_wrong_ = false;  // does not match what was announced: not kept
};

/// Files identified by their SHA-256. A stored file is always complete.
/// Threads: safe.
class AssetStore {
 public:
  /// Both folders exist and are on the same file system. Keeps the uploads that a killed coordinator left in
  /// `incoming_folder`, within the limits above.
  AssetStore(std::string folder, std::string incoming_folder);

  /// Whether the asset is stored. False for text that is not a SHA-256.
  bool Has(const std::string& sha256) const;

  /// How many bytes of an asset are kept from an upload that broke; 0 for none.
  uint64_t ReceivedBytes(const std::string& sha256) const;

  /// Begins to receive an asset.
  /// Errors: kInvalidArgument where `asset` has no valid SHA-256; kUnavailable for a disk error.
  absl::StatusOr<std::unique_ptr<AssetUpload>> Receive(const v1::AssetRef& asset);

  /// Reads an asset from `offset` on.
  /// Errors: kNotFound naming it; kOutOfRange past its end.
  absl::StatusOr<rpc::ByteSender> Open(const std::string& sha256, uint64_t offset) const;

 private:
  std::string PathOf(const std::string& sha256) const { return folder_ + "/" + sha256; }
  std::string KeptPathOf(const std::string& sha256) const;

  const std::string folder_;
  const std::string incoming_folder_;
  std::atomic<int64_t> uploads_{0};
};

}  // namespace lumifold::server
