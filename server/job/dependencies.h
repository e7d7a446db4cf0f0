#pragma once

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "lumifold/v1/job.pb.h"
#include "server/job/ids.h"

namespace lumifold::job {

/// A job that another one waits for, and its state; JOB_STATE_UNSPECIFIED if it was deleted.
struct Prerequisite {
  JobId job;
  v1::JobState state = v1::JOB_STATE_UNSPECIFIED;
};

/// A job that can never start, and why.
struct HopelessJob {
  JobId job;
  std::string reason;
};

/// Jobs that no longer wait, each once.
struct Settled {
  /// All jobs that they waited for are done; in the order in which the jobs were added.
  std::vector<JobId> released;
  /// Jobs that wait for one that did not end well, jobs that wait for those, and so on; a job comes after the
  /// one that is its reason.
  std::vector<HopelessJob> hopeless;
};

/// Jobs that wait until other jobs are done (v1::Scheduling.after). Pure state, a function of the calls so
/// far.
///
/// Cycles cannot occur: a job names jobs that were submitted before it, and its list never changes.
/// Time: O(log n) for each job that a call names or returns and for each job that waits for one of them.
/// Threads: one at a time.
class Dependencies {
 public:
  /// Adds a job and what it waits for.
  Settled Add(const JobId& job, absl::Span<const Prerequisite> after);
  /// A job has ended in this state: DONE, FAILED or CANCELLED. It may itself be one that waits.
  Settled Ended(const JobId& job, v1::JobState state);
  /// An ended job runs again: jobs that still wait, for it among others, wait for it once more.
  void Reopened(const JobId& job);
  /// An ended job was deleted.
  Settled Deleted(const JobId& job) { return Ended(job, v1::JOB_STATE_UNSPECIFIED); }

  /// A job no longer waits, for a reason of its own.
  void Remove(const JobId& job);

  bool IsWaiting(const JobId& job) const { return waiting_.contains(job); }
  /// The jobs that a job waits for and that are not done, in ascending order; empty if it does not wait.
  std::vector<JobId> WaitsFor(const JobId& job) const;
  /// Whether some job waits and names this one, done or not: deleting it would make that job hopeless.
  bool IsNamed(const JobId& job) const { return !NamedBy(job).empty(); }
  /// All jobs that IsNamed. Linear.
  std::set<JobId> Named() const;

 private:
  struct Waiting {
    int64_t number = 0;  // order in which it was added
    std::set<JobId> after;
    std::set<JobId> unmet;
  };

  std::vector<JobId> NamedBy(const JobId& job) const;

  int64_t next_number_ = 0;
  std::map<JobId, Waiting> waiting_;
  std::set<std::pair<JobId, JobId>> named_by_;  // a job, and one that waits and names it
};

}  // namespace lumifold::job
