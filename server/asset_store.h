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

/// An asset on its way in. Nothing is left of it unless Finish succeeds.
/// Threads: one at a time.
class AssetUpload {
 public:
  ~AssetUpload();
  AssetUpload(const AssetUpload&) = delete;
  AssetUpload& operator=(const AssetUpload&) = delete;

  /// Takes the next piece. Errors: as ByteReceiver::Add; kDataLoss where the size is not the one announced.
  absl::Status Add(const v1::ByteChunk& chunk);

  /// Keeps the asset.
  /// Errors: kDataLoss naming it when size or SHA-256 are not those announced; kUnavailable when the disk
  /// refuses.
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

/// Files known by their SHA-256. A file is there whole or not at all.
/// Threads: safe.
class AssetStore {
 public:
  /// Both folders exist and lie on one file system.
  AssetStore(std::string folder, std::string incoming_folder);

  /// Whether the asset is there. False for what is no SHA-256.
  bool Has(const std::string& sha256) const;

  /// Errors: kInvalidArgument where `asset` names no SHA-256; kUnavailable when the disk refuses.
  absl::StatusOr<std::unique_ptr<AssetUpload>> Receive(const v1::AssetRef& asset);

  /// Reads an asset from an offset on. Errors: kNotFound naming it; kOutOfRange past its end.
  absl::StatusOr<rpc::ByteSender> Open(const std::string& sha256, uint64_t offset) const;

 private:
  std::string PathOf(const std::string& sha256) const { return folder_ + "/" + sha256; }

  const std::string folder_;
  const std::string incoming_folder_;
  std::atomic<int64_t> uploads_{0};
};

}  // namespace lumifold::server
