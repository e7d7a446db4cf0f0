#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/image/tile_samples.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/rounds.pb.h"
#include "server/job/frame_sampling.h"
#include "server/job/tile_grid.h"
#include "server/job/unit.h"

namespace lumifold::job {

/// The rounds of a frame of a job with adaptive sampling, as far as they are decided: round r is pass r of
/// every tile that gets samples in it. A function of the spec and of the estimates, so that whoever reads the
/// record of the estimates knows every unit of the frame.
/// Threads: safe concurrently; it does not change.
class FrameRounds {
 public:
  /// Before the first estimate. `spec` is normalised and has adaptive sampling.
  explicit FrameRounds(const v1::JobSpec& spec);
  /// With the estimates of a record.
  /// Errors: kDataLoss where an estimate does not fit the frame or the rounds before it.
  static absl::StatusOr<FrameRounds> Replay(const v1::JobSpec& spec, const v1::RoundEstimates& estimates);

  /// Rounds decided.
  int count() const { return static_cast<int>(sampling_.rounds().size()); }
  /// No round follows those decided.
  bool is_final() const { return sampling_.is_final(); }
  /// Rounds whose estimates have been added, round 0 included, which needs none.
  int estimated() const { return estimated_; }
  /// See job::FrameSampling::PredictedError.
  double predicted_error() const { return sampling_.PredictedError(); }
  /// See job::FrameSampling::MeasuredError.
  double MeasuredError(absl::Span<const double> errors) const { return sampling_.MeasuredError(errors); }
  /// See job::FrameSampling::NeedsPicture.
  bool NeedsPicture(absl::Span<const double> costs) const { return sampling_.NeedsPicture(costs); }
  bool NeedsPictureAt(double rays) const { return sampling_.NeedsPictureAt(rays); }
  /// See job::FrameSampling::MeanCostOf.
  double MeanCostOf(int round, absl::Span<const double> costs) const {
    return sampling_.MeanCostOf(round, costs);
  }
  /// Of a job with a time: its render time when the last estimated round was committed.
  double rendered_seconds() const { return rendered_seconds_; }
  /// The budgets of a job with a time or a schedule, in the order of the estimates.
  const std::vector<double>& schedule() const { return schedule_; }

  /// False for a pass that is not decided, and for one in which the tile gets no samples. True for geometry.
  bool Has(const UnitKey& unit) const;
  /// Sample indices of a unit that the frame Has; empty for geometry.
  TileSamples SamplesOf(const UnitKey& unit) const;
  /// Camera samples of such a unit, over all its pixels.
  int64_t CameraSamplesOf(const UnitKey& unit) const;

 private:
  TileGrid tiles_;
  job::FrameSampling sampling_;
  int estimated_ = 1;
  double rendered_seconds_ = 0;
  std::vector<double> schedule_;
};

}  // namespace lumifold::job
