#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "worker/cache/asset_source.h"

namespace lumifold::worker {

/// A source that counts what it delivers. `source` must outlive it.
/// Threads: safe concurrently.
class CountedAssets final : public AssetSource {
 public:
  explicit CountedAssets(AssetSource* source) : source_(source) {}

  /// Errors: those of the source.
  absl::StatusOr<AssetContent> Fetch(const std::string& job_id, const v1::AssetRef& asset) override {
    absl::StatusOr<AssetContent> content = source_->Fetch(job_id, asset);
    if (content.ok()) {
      ++assets_;
      bytes_ += static_cast<int64_t>((*content)->size());
    }
    return content;
  }

  int64_t assets() const { return assets_; }
  int64_t bytes() const { return bytes_; }

 private:
  AssetSource* const source_;
  std::atomic<int64_t> assets_ = 0;
  std::atomic<int64_t> bytes_ = 0;
};

}  // namespace lumifold::worker
