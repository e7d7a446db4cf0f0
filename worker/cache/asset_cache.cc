#include "worker/cache/asset_cache.h"

#include <memory>
#include <utility>

namespace lumifold::worker {

absl::StatusOr<std::string> AssetCache::Fetch(const std::string& job_id, const v1::AssetRef& asset) {
  using Content = std::shared_ptr<const std::string>;
  bool is_hit = true;
  const auto fetch = [&]() -> absl::StatusOr<Content> {
    is_hit = false;
    absl::StatusOr<std::string> bytes = source_->Fetch(job_id, asset);
    if (!bytes.ok()) return bytes.status();
    return std::make_shared<const std::string>(*std::move(bytes));
  };
  const absl::StatusOr<Content> content =
      cache_.Get(asset.sha256(), fetch, [](const std::string& bytes) -> uint64_t { return bytes.size(); });
  if (!content.ok()) return content.status();
  if (is_hit) ++hits_;
  return **content;
}

}  // namespace lumifold::worker
