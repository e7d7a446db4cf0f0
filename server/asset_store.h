#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/image.pb.h"
#include "lumifold/v1/scene.pb.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/sha256.h"

namespace lumifold::server {

/// An asset that is being received. Its file is removed unless Finish succeeds.
/// Threads: one at a time.
class AssetUpload {
 public:
  ~AssetUpload();
  AssetUpload(const AssetUpload&) = delete;
  AssetUpload& operator=(const AssetUpload&) = delete;

  /// Adds the next piece.
  /// Errors: as ByteReceiver::Add; kDataLoss where the size is not the announced one.
  absl::Status Add(const v1::ByteChunk& chunk);

  /// Stores the asset.
  /// Errors: kDataLoss naming it when size or SHA-256 are not the announced ones; kUnavailable for a disk
  /// error.
  absl::Status Finish();

 private:
  friend class AssetStore;
  AssetUpload(v1::AssetRef asset, std::string incoming_path, std::string final_path,
              rpc::ByteReceiver receiver);
  absl::Status Mismatch(const std::string& cause) const;

  const v1::AssetRef asset_;
  const std::string incoming_path_;
  const std::string final_path_;
  rpc::ByteReceiver receiver_;
  rpc::Sha256 sum_;
};

/// Files identified by their SHA-256. A stored file is always complete.
/// Threads: safe.
class AssetStore {
 public:
  /// Both folders exist and are on the same file system.
  AssetStore(std::string folder, std::string incoming_folder);

  /// Whether the asset is stored. False for text that is not a SHA-256.
  bool Has(const std::string& sha256) const;

  /// Begins to receive an asset.
  /// Errors: kInvalidArgument where `asset` has no valid SHA-256; kUnavailable for a disk error.
  absl::StatusOr<std::unique_ptr<AssetUpload>> Receive(const v1::AssetRef& asset);

  /// Reads an asset from `offset` on.
  /// Errors: kNotFound naming it; kOutOfRange past its end.
  absl::StatusOr<rpc::ByteSender> Open(const std::string& sha256, uint64_t offset) const;

 private:
  std::string PathOf(const std::string& sha256) const { return folder_ + "/" + sha256; }

  const std::string folder_;
  const std::string incoming_folder_;
  std::atomic<int64_t> uploads_{0};
};

}  // namespace lumifold::server
