#pragma once

#include <atomic>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "worker/spec_cache.h"

namespace lumifold::worker {

/// Returns the same spec, or error, for every job.
class FakeSpecs final : public SpecSource {
 public:
  explicit FakeSpecs(absl::StatusOr<v1::JobSpec> spec) : spec_(std::move(spec)) {}

  absl::StatusOr<v1::JobSpec> Fetch(const std::string&) override {
    ++fetches;
    return spec_;
  }

  std::atomic<int> fetches = 0;

 private:
  const absl::StatusOr<v1::JobSpec> spec_;
};

}  // namespace lumifold::worker
