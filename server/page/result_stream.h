#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "lumifold/v1/farm.pb.h"

namespace lumifold::page {

class FarmCalls;

/// A frame's file while it comes from the coordinator.
/// Threads: one at a time; calls block.
class ResultStream {
 public:
  virtual ~ResultStream() = default;

  /// Begins where the request says. Errors: those of DownloadResult.
  static absl::StatusOr<std::unique_ptr<ResultStream>> Open(const FarmCalls& calls,
                                                            const v1::PageSession& session,
                                                            const v1::DownloadResultRequest& request);

  /// The next piece; nullopt after the last one. Errors: those of DownloadResult.
  virtual absl::StatusOr<std::optional<std::string>> Next() = 0;
  /// Of the whole file: bytes, and SHA-256 in hexadecimal digits.
  virtual uint64_t size() const = 0;
  virtual const std::string& sha256() const = 0;
};

}  // namespace lumifold::page
