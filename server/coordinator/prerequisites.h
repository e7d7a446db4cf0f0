#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"
#include "server/job/dependencies.h"

namespace lumifold::server {

/// Jobs that other jobs wait for, as the ledger has them.
/// Threads: safe. All calls read the ledger.
class Prerequisites {
 public:
  /// Both must outlive it.
  Prerequisites(const Resources* resources, FarmState* state) : resources_(resources), state_(state) {}

  /// As Read, of a new job. Errors: also kInvalidArgument naming a job that is not known, or for too many.
  absl::StatusOr<std::vector<job::Prerequisite>> Check(const v1::Scheduling& scheduling) const;
  /// The jobs that `scheduling` names, in the states that the ledger has. Errors: those of the ledger.
  absl::StatusOr<std::vector<job::Prerequisite>> Read(const v1::Scheduling& scheduling) const;
  /// Looks again at jobs that had not ended when they were read, and may have left memory before the job that
  /// waits for them was started.
  void LookAgain(const std::vector<job::Prerequisite>& after) const;
  /// Looks at all jobs that others wait for and that are not in memory: other coordinators may have ended
  /// them.
  void LookAtAll() const;

 private:
  const Resources* const resources_;
  FarmState* const state_;
};

}  // namespace lumifold::server
