#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "lumifold/v1/job.pb.h"
#include "server/job/frame_list.h"
#include "server/job/frame_rounds.h"
#include "server/job/tile_grid.h"
#include "server/job/unit.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// Which units a job has: frames, and the units of each. A job without a plan that needs one has one unit,
/// its plan unit.
class JobUnits {
 public:
  /// Sizes of units whose times are compared: geometry, a short pass 0, and other passes.
  static constexpr size_t kSizes = 3;

  explicit JobUnits(const v1::JobSpec& spec);

  const v1::JobSpec& spec() const { return spec_; }
  const job::FrameUnits& of_frame() const { return of_frame_; }
  /// The first one only until the job is planned.
  const job::FrameList& frames() const { return frames_; }
  /// Of every frame; null without adaptive sampling.
  const std::shared_ptr<const job::FrameRounds>& first_rounds() const { return first_rounds_; }

  /// Units of a frame that are leased in the order of their numbers. Those of later rounds become free one by
  /// one.
  int64_t ordered() const;
  /// Of all frames, as far as their rounds are decided.
  int64_t total() const { return ordered() * frames_.count() + later_; }
  /// Counts units of rounds that are decided after the first ones.
  void AddLater(int64_t units) { later_ += units; }

  /// nullopt for a unit that the job does not have.
  std::optional<Place> PlaceOf(const job::UnitKey& key) const;
  job::UnitKey KeyOf(const Place& place) const;
  /// Below kSizes.
  size_t SizeOf(const Place& place) const;

 private:
  v1::JobSpec spec_;
  job::FrameUnits of_frame_;
  job::FrameList frames_;
  std::shared_ptr<const job::FrameRounds> first_rounds_;
  int64_t later_ = 0;
};

}  // namespace lumifold::scheduler
