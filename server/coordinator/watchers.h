#pragma once

#include <map>
#include <optional>
#include <set>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "lumifold/v1/job.pb.h"
#include "server/coordinator/roles.h"
#include "server/job/ids.h"

namespace lumifold::server {

/// Who watches which job, and which jobs have changed since the watchers were told. Pure state.
/// Threads: one at a time.
class Watchers {
 public:
  void Add(JobWatcher* watcher, const job::JobId& job) { watchers_[watcher] = job; }
  void Remove(JobWatcher* watcher) { watchers_.erase(watcher); }

  void MarkChanged(const job::JobId& job);
  /// Whether a job has changed since the last call.
  bool TakeNews();
  /// When Notify has something to do; InfiniteFuture if no job has changed.
  absl::Time due() const;
  /// Tells watchers of the jobs that have changed, at most ten times a second. `status`: of a job; nullopt if
  /// it is not in memory.
  void Notify(absl::Time now, absl::FunctionRef<std::optional<v1::JobStatus>(const job::JobId&)> status);
  /// Tells watchers of a job its last status, or why they are told no more.
  void NotifyEnd(const job::JobId& job, const absl::StatusOr<v1::JobStatus>& last) const;

 private:
  std::map<JobWatcher*, job::JobId> watchers_;
  std::set<job::JobId> changed_;
  bool has_news_ = false;
  absl::Time notified_ = absl::InfinitePast();
};

}  // namespace lumifold::server
