#pragma once

#include <string>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/frames.h"
#include "server/scheduler/leasing.h"
#include "server/scheduler/state.h"
#include "server/scheduler/workers.h"

namespace lumifold::scheduler {

/// What follows from audits: a share of the units of a job, chosen by a hash of job and unit, is leased again
/// to a worker of another name once it is accepted. Equal digests settle the audit; otherwise further workers
/// decide by majority, and a worker in the minority is blocked, and its units of frames that are not finished
/// are revoked. A restart begins the audits of unfinished frames again.
///
/// Time: a verdict about a faulty worker looks at each unit of the active frames.
///
/// Threads: one at a time.
class Audits {
 public:
  /// All must outlive it.
  Audits(State* state, Frames* frames, Leasing* leasing, Workers* workers);

  /// Audits an accepted unit, if it is among the share of its job.
  void Begin(const UnitIndex& unit, const std::string& worker, absl::string_view digest, absl::Time now);
  /// The audit's lease is delivered.
  void Complete(job::Attempt attempt, absl::string_view digest, absl::Time now);
  /// The worker, whose lease for an audit has ended, could not render the unit.
  void Decline(const UnitIndex& unit, job::WorkerId worker);
  /// Ends the audit of a unit, if there is one.
  void End(const UnitIndex& unit);
  /// Waives audits for which no worker is available.
  void Expire(absl::Time now);
  /// A unit is committed: it is to be revoked if its worker was found faulty meanwhile.
  void OnCommitted(const UnitIndex& unit);

  /// Blocks a worker, by name, whose results are wrong, and has its units of frames that are not finished
  /// revoked (Workers::TakeFaulty).
  void BlockFaulty(const std::string& worker, const std::string& reason);

  /// Whether a worker is available that may audit the unit, which is audited. O(names asked so far).
  static bool HasAuditor(const State& state, const UnitIndex& unit);

 private:
  State* const state_;
  Frames* const frames_;
  Leasing* const leasing_;
  Workers* const workers_;
};

}  // namespace lumifold::scheduler
