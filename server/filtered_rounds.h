#pragma once

#include <array>
#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/metrics/error_estimate.h"
#include "server/committed_units.h"
#include "server/data_folder.h"
#include "server/job/frame_rounds.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// A frame as it is after one of its rounds.
struct FilteredRound {
  EdgedImage film;
  std::array<Plane, 3> picture;  // filtered
};

/// What the filter makes of a frame with adaptive sampling after each of its rounds. One picture is kept in a file beside the
/// units, because every round is compared with an earlier one: so each is filtered once.
/// All arguments must outlive it. `pool` may be null; results do not depend on it.
/// Threads: one at a time for each frame.
class FilteredRounds {
 public:
  FilteredRounds(const DataFolder& folder, const ledger::JobRecord& job, int32_t frame,
                 const job::FrameRounds& rounds, const CommittedUnits& units, TaskPool* pool)
      : folder_(folder), job_(job), frame_(frame), rounds_(rounds), units_(units), pool_(pool) {}

  /// The frame after `round`, whose units are committed. The picture is the kept one, or is filtered.
  /// Errors: those of UnitFilm and FilterFilm.
  absl::StatusOr<FilteredRound> Get(int round) const;
  /// Keeps the picture of this round in place of another. Errors: kUnavailable naming the file.
  absl::Status Keep(int round, const FilteredRound& filtered) const;
  /// Estimated errors of the later of two rounds, by block, in the metric of the job.
  metrics::ErrorEstimate Compare(const FilteredRound& earlier, const FilteredRound& later) const;

 private:
  /// The kept picture, if it is of this round and undamaged.
  absl::StatusOr<std::array<Plane, 3>> ReadKept(int round) const;

  const DataFolder& folder_;
  const ledger::JobRecord& job_;
  const int32_t frame_;
  const job::FrameRounds& rounds_;
  const CommittedUnits& units_;
  TaskPool* const pool_;
};

}  // namespace lumifold::server
