#pragma once

#include "absl/time/time.h"
#include "server/scheduler/evidence.h"
#include "server/scheduler/state.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// Whether the job or a worker is at fault when a unit is called impossible. One rule for all ways in which a
/// unit fails:
///
/// * A job fails when two witnesses call the same unit impossible, or three parties.
/// * It fails after DisputeOptions::patience in which nobody else could be asked, when one witness calls the
///   unit impossible, or two parties.
/// * Otherwise it waits. The word of one party that has delivered nothing never fails a job.
/// * When the unit is rendered, those who called it impossible are at fault (WorkerHealth).
/// * Who called a unit impossible gets no units of that job for SchedulerOptions::cool_down, except the
///   first one that another party calls impossible: it is asked about that.
///
/// Threads: one at a time.
class Disputes {
 public:
  explicit Disputes(State* state) : state_(state) {}

  /// What is known of the unit, which is not accepted, has changed.
  void Judge(const UnitIndex& unit, absl::Time now);
  /// Judges what has waited for the patience.
  void Expire(absl::Time now);
  /// Whether a worker is available that has not called the unit impossible. O(workers).
  static bool CanAskAnother(const State& state, const UnitIndex& unit);

 private:
  void Fail(const UnitIndex& unit, const Evidence::Record& record);

  State* const state_;
};

}  // namespace lumifold::scheduler
