#pragma once

#include <memory>
#include <new>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "worker/cache/asset_source.h"

namespace lumifold::worker {

/// Returns the same scene, or error, for every asset except `environment`.
class FakeAssets final : public AssetSource {
 public:
  explicit FakeAssets(absl::StatusOr<std::string> content, std::string environment = "")
      : content_(std::move(content)), environment_(std::move(environment)) {}

  absl::StatusOr<AssetContent> Fetch(const std::string&, const v1::AssetRef& asset) override {
    absl::MutexLock lock(&mutex_);
    ++fetches_;
    if (bad_allocs_ > 0) {
      --bad_allocs_;
      throw std::bad_alloc();
    }
    mutex_.Await(absl::Condition(&open_));
    const bool is_environment = asset.uri().rfind("environment:", 0) == 0;
    if (is_environment && !environment_.empty()) return std::make_shared<const std::string>(environment_);
    if (!content_.ok()) return content_.status();
    return std::make_shared<const std::string>(*content_);
  }

  /// While closed, Fetch blocks.
  void SetOpen(bool open) {
    absl::MutexLock lock(&mutex_);
    open_ = open;
  }
  /// So many fetches find no memory.
  void FindNoMemory(int times) {
    absl::MutexLock lock(&mutex_);
    bad_allocs_ = times;
  }
  void AwaitFetches(int count) {
    absl::MutexLock lock(&mutex_);
    const auto reached = [&] { return fetches_ >= count; };
    mutex_.Await(absl::Condition(&reached));
  }
  int fetches() {
    absl::MutexLock lock(&mutex_);
    return fetches_;
  }

 private:
  absl::Mutex mutex_;
  bool open_ = true;
  int fetches_ = 0;
  int bad_allocs_ = 0;
  absl::StatusOr<std::string> content_;
  std::string environment_;
};

}  // namespace lumifold::worker
