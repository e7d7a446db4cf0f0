#pragma once

#include <atomic>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "worker/cache/spec_cache.h"

namespace lumifold::worker {

/// Returns the same spec, or error, for every job.
class FakeSpecs final : public SpecSource {
 public:
  explicit FakeSpecs(absl::StatusOr<v1::JobSpec> spec) : spec_(std::move(spec)) {}

  absl::StatusOr<v1::JobSpec> Fetch(const std::string&) override {
    ++fetches;
    absl::MutexLock lock(&mutex_);
    return spec_;
  }
  void Set(absl::StatusOr<v1::JobSpec> spec) {
    absl::MutexLock lock(&mutex_);
    spec_ = std::move(spec);
  }

  std::atomic<int> fetches = 0;

 private:
  absl::Mutex mutex_;
  absl::StatusOr<v1::JobSpec> spec_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::worker
