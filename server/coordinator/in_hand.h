#pragma once

#include <map>
#include <set>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/time/time.h"
#include "lumifold/v1/worker.pb.h"
#include "server/job/ids.h"
#include "server/job/unit.h"

namespace lumifold::server {

/// A unit that a worker has in hand, see v1::Hello. `attempt`: of the connection that broke.
struct UnitInHand {
  job::WorkerId worker;
  job::UnitRef unit;
  job::Attempt attempt;
  absl::Time until;  // when it is forgotten here
};

/// Units that connected workers have in hand, of jobs that are not active here. Pure state.
/// Threads: one at a time.
class UnitsInHand {
 public:
  /// Notes what a worker that connects at `now` has.
  void Add(job::WorkerId worker, const v1::Hello& hello, absl::Time now);
  void ForgetWorker(job::WorkerId worker);
  void ForgetExpired(absl::Time now);
  /// Takes those of jobs for which `has_job` is true, by worker.
  std::map<job::WorkerId, std::vector<UnitInHand>> Take(absl::FunctionRef<bool(const job::JobId&)> has_job);
  std::vector<job::JobId> Jobs() const;
  std::set<job::WorkerId> WorkersWith(const job::JobId& job) const;

 private:
  void Forget(absl::FunctionRef<bool(const UnitInHand&)> condition);

  std::map<job::JobId, std::vector<UnitInHand>> units_;
};

}  // namespace lumifold::server
