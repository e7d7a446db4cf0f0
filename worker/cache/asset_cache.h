#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "worker/cache/asset_source.h"
#include "worker/cache/content_cache.h"

namespace lumifold::worker {

/// Bytes of assets that a worker keeps. An animation loads its scene for each frame: with assets within this
/// limit only the first frame fetches them. Half of it makes more animations fetch every frame; twice as much
/// is memory that the renderer may need.
inline constexpr uint64_t kAssetCacheBytes = uint64_t{512} << 20;

/// Keeps the content of assets by SHA-256.
/// Threads: safe concurrently; threads that want an asset that is being fetched wait for it.
class AssetCache final : public AssetSource {
 public:
  /// `source` must outlive it. An asset larger than `max_bytes` is not kept.
  AssetCache(AssetSource* source, uint64_t max_bytes) : source_(source), cache_(max_bytes) {}

  /// Errors: those of the source; they are not kept.
  absl::StatusOr<AssetContent> Fetch(const std::string& job_id, const v1::AssetRef& asset) override;

  /// Assets that it had, or another thread was fetching.
  int64_t hits() const { return hits_; }
  uint64_t bytes() const { return cache_.bytes(); }

 private:
  AssetSource* const source_;
  ContentCache<std::string> cache_;
  std::atomic<int64_t> hits_ = 0;
};

}  // namespace lumifold::worker
