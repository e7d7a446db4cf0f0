#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"

namespace lumifold::job_life {

/// Maximum number of uploads at a time. Each holds a file descriptor and up to one message in memory.
inline constexpr int kMaxUploads = 64;

/// The bytes that running uploads have announced and not yet sent. An upload may only go on if all of them fit the
/// room that is left, so that uploads cannot fill the disk between them. Pure state.
/// Threads: one at a time.
class UploadBudget {
 public:
  /// An upload is announced; `name` is for errors.
  /// Errors: kResourceExhausted where kMaxUploads are running.
  absl::Status Begin(const std::string& name);
  /// `bytes` of an upload are to come. `room` is what uploads may take at this moment: of the disk or of the quota,
  /// whichever has less.
  /// Errors: kResourceExhausted with the numbers; the upload expects nothing then.
  absl::Status Expect(const std::string& name, uint64_t bytes, uint64_t room);
  /// `bytes` of those that were expected have arrived: they use the disk now, no longer the budget.
  void Arrived(uint64_t bytes);
  /// An upload has ended; `bytes` of those that were expected did not arrive.
  void End(uint64_t bytes);

  int uploads() const { return uploads_; }
  uint64_t expected_bytes() const { return expected_bytes_; }

 private:
  int uploads_ = 0;
  uint64_t expected_bytes_ = 0;
};

}  // namespace lumifold::job_life
