#include "worker/cache/asset_cache.h"

namespace lumifold::worker {

absl::StatusOr<AssetContent> AssetCache::Fetch(const std::string& job_id, const v1::AssetRef& asset) {
  bool is_hit = true;
  const auto fetch = [&] {
    is_hit = false;
    return source_->Fetch(job_id, asset);
  };
  absl::StatusOr<AssetContent> content =
      cache_.Get(asset.sha256(), fetch, [](const std::string& bytes) -> uint64_t { return bytes.size(); });
  if (content.ok() && is_hit) ++hits_;
  return content;
}

}  // namespace lumifold::worker
