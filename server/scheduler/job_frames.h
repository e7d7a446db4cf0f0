#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "filter/image/tile_samples.h"
#include "server/job/frame_rounds.h"
#include "server/scheduler/job_units.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// A frame from its first lease or committed unit until its result is written.
struct FrameState {
  std::vector<bool> taken;                         // accepted or committed, by unit number
  std::shared_ptr<const job::FrameRounds> rounds;  // null without adaptive sampling
  /// With rounds: units that are not committed, of the geometry and of each round.
  std::vector<int64_t> left;
  std::vector<uint32_t> deliverers;  // numbers of the workers' names, 0 for none; by unit number
  int64_t committed = 0;
  std::set<int64_t> revoking;  // units of faulty workers that the caller has not revoked yet
};

/// The frames of a job, by index: active ones, those that are committed, and those that are finished. Pure
/// state. Time: O(log n) a call, unless it says otherwise.
///
/// Threads: one at a time.
class JobFrames {
 public:
  explicit JobFrames(int count) : over_(static_cast<size_t>(count)) {}

  const std::map<int, FrameState>& active() const { return active_; }
  bool IsActive(int frame) const { return active_.contains(frame); }
  /// Null for a frame that is not active; valid until it is finished.
  FrameState* Find(int frame);
  const FrameState* Find(int frame) const;
  /// Makes a frame active that is neither active nor finished. O(units of a frame).
  FrameState& Open(int frame, const JobUnits& units);
  int finished_count() const { return finished_count_; }
  /// The active frame's result is written.
  void Finish(int frame);
  /// The frame, which is neither active nor finished, is left out.
  void Skip(int frame);
  int skipped_count() const { return skipped_count_; }
  /// Whether nothing is left to do for a frame: it is finished or skipped.
  bool IsOver(int frame) const { return over_[static_cast<size_t>(frame)]; }
  bool AreAllOver() const { return finished_count_ + skipped_count_ == static_cast<int>(over_.size()); }
  /// The frame, which is not active, was finished before a restart: its units count as committed.
  void RestoreFinished(int frame, const JobUnits& units);

  /// Sets the rounds of an active frame, and returns the places of the units that this adds.
  std::vector<Place> SetRounds(int frame, std::shared_ptr<const job::FrameRounds> rounds,
                               const JobUnits& units);
  /// Sample indices of a unit of an active frame.
  TileSamples SamplesOf(const Place& place, const JobUnits& units) const;

  /// Whether the unit is accepted or committed.
  bool HasResult(const Place& place) const;
  /// Counts a unit of an active frame as committed, or no more as such.
  void Commit(const Place& place, const JobUnits& units) { Count(place, units, 1); }
  void Revoke(const Place& place, const JobUnits& units) { Count(place, units, -1); }
  int64_t committed_units() const { return committed_units_; }
  int64_t committed_samples() const { return committed_samples_; }
  /// Whether all units of an active frame, and all its rounds, are committed. O(rounds).
  static bool IsComplete(const FrameState& frame, const JobUnits& units);
  /// Active frames that are committed, see Frames::UpdateCommitted.
  const std::set<int>& committed() const { return committed_; }
  void MarkCommitted(int frame, bool is_committed);

 private:
  void Count(const Place& place, const JobUnits& units, int change);

  std::map<int, FrameState> active_;
  std::set<int> committed_;
  std::vector<bool> over_;
  int finished_count_ = 0;
  int skipped_count_ = 0;
  int64_t committed_units_ = 0;
  int64_t committed_samples_ = 0;
};

}  // namespace lumifold::scheduler
