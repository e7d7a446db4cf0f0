#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <set>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "worker/asset_source.h"

namespace lumifold::worker {

/// Bytes of assets that a worker keeps. An animation loads its scene for each frame: with assets within this
/// limit only the first frame fetches them. Half of it makes more animations fetch every frame; twice as much
/// is memory that the renderer may need.
inline constexpr uint64_t kAssetCacheBytes = uint64_t{512} << 20;

/// Keeps the content of assets by SHA-256, the most recently used within a limit of bytes. Threads that want
/// an asset that is being fetched wait for it.
/// Threads: safe concurrently.
class AssetCache final : public AssetSource {
 public:
  /// `source` must outlive it. An asset larger than `max_bytes` is not kept.
  AssetCache(AssetSource* source, uint64_t max_bytes) : source_(source), max_bytes_(max_bytes) {}

  /// Errors: those of the source; they are not kept.
  absl::StatusOr<std::string> Fetch(const v1::AssetRef& asset) override;

 private:
  struct Entry {
    std::string sha256;
    std::string bytes;
  };

  const std::string* Find(const std::string& sha256) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Keep(const std::string& sha256, const std::string& bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  AssetSource* const source_;
  const uint64_t max_bytes_;
  absl::Mutex mutex_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  // most recently used first
  std::map<std::string, std::list<Entry>::iterator> by_sha256_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> fetching_ ABSL_GUARDED_BY(mutex_);
  uint64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace lumifold::worker
