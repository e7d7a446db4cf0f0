#pragma once

#include <set>

#include "server/scheduler/job_frames.h"
#include "server/scheduler/job_units.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// The free units of a job: those that were leased in vain, and from `next` on those that were never leased,
/// in the order in which they are leased. Pure state. Time: O(log n) for each unit.
///
/// Threads: one at a time.
class FreeUnits {
 public:
  /// Leased once, and free again or overdue; or of a later round.
  const std::set<Place>& returned() const { return returned_; }
  void Return(const Place& place) { returned_.insert(place); }
  /// The unit is not free any more, if it is among the returned ones.
  void Withdraw(const Place& place) { returned_.erase(place); }

  /// Units from here on were never leased. Its unit is free after Advance; its frame is past the last one if
  /// there is none.
  const Place& next() const { return next_; }
  /// Moves `next` on to the first unit that is neither accepted nor committed, or the first frame that is not
  /// active.
  void Advance(const JobUnits& units, const JobFrames& frames);
  /// The unit at `next` is leased. Advance follows.
  void TakeNext() { ++next_.number; }
  /// `next` never comes to the units of this frame. Advance follows.
  void Pass(int frame) { passed_.insert(frame); }
  /// Whether `next` will come to the unit; the others are free only if they are returned.
  bool IsInOrder(const Place& place, const JobUnits& units) const {
    return place >= next_ && place.number < units.ordered() && !passed_.contains(place.frame);
  }

 private:
  Place next_;
  std::set<Place> returned_;
  std::set<int> passed_;
};

}  // namespace lumifold::scheduler
