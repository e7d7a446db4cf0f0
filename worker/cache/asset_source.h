#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "lumifold/v1/scene.pb.h"

namespace lumifold::worker {

/// The content of an asset, which a cache and those who use it share.
using AssetContent = std::shared_ptr<const std::string>;

/// Source of the files of a job.
/// Threads: implementations are safe concurrently.
class AssetSource {
 public:
  virtual ~AssetSource() = default;

  /// The content of an asset of the job, checked against its size and SHA-256.
  /// Errors: kNotFound; kDataLoss when the SHA-256 does not match; kUnavailable when the coordinator cannot
  /// be reached; kPermissionDenied when this worker has no lease of the job any more.
  virtual absl::StatusOr<AssetContent> Fetch(const std::string& job_id, const v1::AssetRef& asset) = 0;
};

}  // namespace lumifold::worker
