#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "lumifold/v1/image.pb.h"
#include "server/commit/committed_units.h"

namespace lumifold::server {

/// Hands out the records of a frame's committed units one after another, as they lie in the unit log, in
/// pieces of a file that has nothing else.
/// Threads: one at a time.
class UnitSender {
 public:
  /// `film_levels`: see v1::ByteChunk.
  explicit UnitSender(CommittedUnits units, uint64_t film_levels = 0)
      : units_(std::move(units)), size_(units_.record_bytes()), film_levels_(film_levels) {}

  /// Fills `chunk` with the next piece; false after the last one.
  /// Errors: kDataLoss, kUnavailable naming the log.
  absl::StatusOr<bool> Next(v1::ByteChunk* chunk);

 private:
  CommittedUnits units_;
  uint64_t size_;
  uint64_t film_levels_;
  int64_t next_unit_ = 0;
  std::string pending_;  // read and not sent
  uint64_t sent_ = 0;
};

}  // namespace lumifold::server
