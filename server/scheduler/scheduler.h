#pragma once

#include <string>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/audits.h"
#include "server/scheduler/disputes.h"
#include "server/scheduler/frames.h"
#include "server/scheduler/grants.h"
#include "server/scheduler/jobs.h"
#include "server/scheduler/keeping.h"
#include "server/scheduler/lease_watch.h"
#include "server/scheduler/leasing.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"
#include "server/scheduler/units.h"
#include "server/scheduler/workers.h"

namespace lumifold::scheduler {

/// Assigns units to workers. Pure state and policy: no clock, no threads, no disk. The state is a function of
/// the calls so far, so that a test can replay any history. Holds active jobs only.
///
/// The state lies in State and its parts, one for each thing. The rules that concern several of them are in
/// Jobs, Frames, Units, Workers and Grants, and in Leasing, LeaseWatch and Audits below these.
///
/// Time: O(log n) for each unit, lease and worker that a call names, returns or changes; n counts jobs,
/// leases and workers. A grant also looks at each distinct pair of class and tags that ready jobs require.
/// Memory: 33 bits for each unit of the active frames, plus leases and audits.
///
/// Threads: one at a time.
class Scheduler {
 public:
  explicit Scheduler(const SchedulerOptions& options);

  Jobs& jobs() { return jobs_; }
  const Jobs& jobs() const { return jobs_; }
  Frames& frames() { return frames_; }
  const Frames& frames() const { return frames_; }
  Units& units() { return units_; }
  const Units& units() const { return units_; }
  Workers& workers() { return workers_; }
  const Workers& workers() const { return workers_; }
  Keeping& keeping() { return keeping_; }
  const Keeping& keeping() const { return keeping_; }

  /// See Grants::ToAll and Grants::ToWorker.
  std::vector<GrantedLease> GrantLeases(absl::Time now) { return grants_.ToAll(now); }
  std::vector<GrantedLease> GrantLeases(job::WorkerId worker, absl::Time now) {
    return grants_.ToWorker(worker, now);
  }
  /// See Leasing::NextAttempt.
  job::Attempt NextAttempt() { return leasing_.NextAttempt(); }
  /// Ends what is over at `now`: leases (see LeaseWatch::Expire), pauses of units, audits that nobody can
  /// settle, and cool-downs of workers.
  std::vector<LateLease> ExpireLeases(absl::Time now);
  /// Jobs that cannot go on, as it turned out since the last call; each once. The caller ends them.
  std::vector<FailedJob> TakeFailedJobs();
  /// See Audits::BlockFaulty.
  void BlockFaulty(const std::string& worker, const std::string& reason) {
    audits_.BlockFaulty(worker, reason);
  }
  /// When ExpireLeases has something to do next; InfiniteFuture if nothing is due.
  absl::Time NextExpiry() const;

  /// See scheduler::Explain.
  std::vector<Reason> Explain(const job::JobId& job, absl::Time now) const;
  /// Counts of units and workers. Linear in jobs, workers and accepted units.
  Metrics CountAll() const;

 private:
  State state_;
  Leasing leasing_;
  Frames frames_;
  Disputes disputes_;
  LeaseWatch watch_;
  Workers workers_;
  Audits audits_;
  Units units_;
  Jobs jobs_;
  Keeping keeping_;
  Grants grants_;
};

}  // namespace lumifold::scheduler
