#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "absl/status/status.h"

namespace lumifold::server {

/// Uploads that are announced and not complete. Each holds a file descriptor and up to one message in memory.
/// One caller may have a quarter of them.
struct UploadLimits {
  int uploads = 64;
  int uploads_of_caller = 16;
  /// Bytes that are to come, of one caller. Those of all are bounded by the room that is left.
  uint64_t bytes_of_caller = 256'000'000'000;
};

/// The bytes that running uploads have announced and not yet sent. An upload may only begin if all of them
/// fit the room that is left, so that uploads cannot fill the disk between them, and those of one caller
/// leave room for others. Pure state.
/// Threads: one at a time.
class UploadBudget {
 public:
  explicit UploadBudget(const UploadLimits& limits = {}) : limits_(limits) {}

  /// `caller` announces an upload of which `bytes` are to come; `name` is for errors. `room` is what uploads
  /// may take at this moment: of the disk or of the quota, whichever has less.
  /// Errors: kResourceExhausted naming the limit and its value; then nothing has begun.
  absl::Status Begin(const std::string& caller, const std::string& name, uint64_t bytes, uint64_t room);
  /// More is to come than was announced, because the upload starts over.
  /// Errors: as Begin; the upload expects what it did before.
  absl::Status Expect(const std::string& caller, const std::string& name, uint64_t bytes, uint64_t room);
  /// `bytes` of those that were expected have arrived: they use the disk now, no longer the budget.
  void Arrived(const std::string& caller, uint64_t bytes);
  /// An upload has ended; `bytes` of those that were expected did not arrive.
  void End(const std::string& caller, uint64_t bytes);

  int uploads() const { return uploads_; }
  uint64_t expected_bytes() const { return expected_bytes_; }

 private:
  struct Use {
    int uploads = 0;
    uint64_t expected_bytes = 0;
  };

  const UploadLimits limits_;
  int uploads_ = 0;
  uint64_t expected_bytes_ = 0;
  std::map<std::string, Use> of_callers_;  // of those that have uploads
};

}  // namespace lumifold::server
