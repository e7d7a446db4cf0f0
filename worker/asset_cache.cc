#include "worker/asset_cache.h"

namespace lumifold::worker {

absl::StatusOr<std::string> AssetCache::Fetch(const v1::AssetRef& asset) {
  {
    absl::MutexLock lock(&mutex_);
    const auto is_settled = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
      return !fetching_.contains(asset.sha256());
    };
    mutex_.Await(absl::Condition(&is_settled));
    if (const std::string* bytes = Find(asset.sha256())) return *bytes;
    fetching_.insert(asset.sha256());
  }
  absl::StatusOr<std::string> bytes = source_->Fetch(asset);
  absl::MutexLock lock(&mutex_);
  fetching_.erase(asset.sha256());
  if (bytes.ok()) Keep(asset.sha256(), *bytes);
  return bytes;
}

const std::string* AssetCache::Find(const std::string& sha256) {
  const auto found = by_sha256_.find(sha256);
  if (found == by_sha256_.end()) return nullptr;
  entries_.splice(entries_.begin(), entries_, found->second);
  return &entries_.front().bytes;
}

void AssetCache::Keep(const std::string& sha256, const std::string& bytes) {
  if (bytes.size() > max_bytes_) return;
  entries_.push_front({sha256, bytes});
  by_sha256_[sha256] = entries_.begin();
  bytes_ += bytes.size();
  while (bytes_ > max_bytes_) {
    bytes_ -= entries_.back().bytes.size();
    by_sha256_.erase(entries_.back().sha256);
    entries_.pop_back();
  }
}

}  // namespace lumifold::worker
