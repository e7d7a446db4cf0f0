#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "lumifold/v1/image.pb.h"
#include "server/commit/committed_units.h"

namespace lumifold::server {

/// Hands out the records of a frame's committed units one after another, as they lie in the unit log, in
/// pieces of a file that ends with the record of the frame's rounds, if it has any.
/// Threads: one at a time.
class UnitSender {
 public:
  /// `film_levels`: see v1::ByteChunk. `rounds`: a v1::RoundEstimates.
  explicit UnitSender(CommittedUnits units, uint64_t film_levels = 0, std::string rounds = "")
      : units_(std::move(units)),
        rounds_(std::move(rounds)),
        size_(units_.record_bytes() + rounds_.size()),
        film_levels_(film_levels) {}

  /// Fills `chunk` with the next piece; false after the last one.
  /// Errors: kDataLoss, kUnavailable naming the log.
  absl::StatusOr<bool> Next(v1::ByteChunk* chunk);

 private:
  /// Fills `bytes` with the next ones.
  absl::Status Read(absl::Span<char> bytes);

  CommittedUnits units_;
  std::string rounds_;
  uint64_t size_;
  uint64_t film_levels_;
  int64_t unit_ = 0;        // whose record comes next; after the last unit the rounds
  uint64_t of_record_ = 0;  // bytes of it that were sent
  uint64_t sent_ = 0;
};

}  // namespace lumifold::server
