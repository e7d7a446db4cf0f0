#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "lumifold/v1/scene.pb.h"

namespace lumifold::worker {

/// Where a worker gets the files of a job from. Threads: implementations are safe concurrently.
class AssetSource {
 public:
  virtual ~AssetSource() = default;

  /// The asset's whole content, checked against its size and SHA-256.
  /// Errors: kNotFound; kDataLoss when the content is not what its name says; kUnavailable when the
  /// coordinator cannot be reached.
  virtual absl::StatusOr<std::string> Fetch(const v1::AssetRef& asset) = 0;
};

}  // namespace lumifold::worker
