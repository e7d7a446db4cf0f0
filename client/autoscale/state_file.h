#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/autoscale/policy/history.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::autoscale {

/// What an autoscaler remembers over restarts, as JSON: failures with their times, and the core-hours of the
/// period. Times are in seconds since 1970.
std::string HistoryJson(const History& history);
/// Errors: kDataLoss.
absl::StatusOr<History> ParseHistory(const std::string& json);

/// The file that holds it, with a checksum. One process at a time has it open; the lock goes with the
/// process.
class StateFile {
 public:
  /// Errors: kFailedPrecondition where another process has it; kUnavailable.
  static absl::StatusOr<StateFile> Open(const std::string& path);

  /// An empty history where there is no file yet.
  /// Errors: kDataLoss for a damaged one: it holds the core-hours, so it is not replaced.
  absl::StatusOr<History> Read() const;
  /// Replaces the file, unless it has this content.
  absl::Status Write(const History& history);

 private:
  StateFile(std::string path, rpc::FileHandle lock) : path_(std::move(path)), lock_(std::move(lock)) {}

  std::string path_;
  rpc::FileHandle lock_;
  std::string written_;
};

}  // namespace lumifold::autoscale
