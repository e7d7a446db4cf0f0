#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/scene.pb.h"
#include "server/coordinator/frame_limit.h"
#include "server/coordinator/roles.h"
#include "server/job/ids.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// A job that is rendered, or waits to be. What is known of it here ends with it.
struct ActiveJob {
  ledger::JobRecord record;
  /// When its render time would have begun, had all of it been spent without a break; nullopt before the
  /// first lease.
  std::optional<absl::Time> render_start;
  UnitBytes unit_bytes;
  /// Units of frames that workers keep, by frame: they are recorded with it.
  std::map<int32_t, ledger::JobCommit> kept;
  /// With adaptive sampling: the largest error of a frame that the last estimates predict.
  std::optional<double> predicted_error;
  /// Number of times that units of an unfinished frame were lost.
  std::map<int32_t, int> losses;
  /// Frames that cannot be rendered and that it is about to go on without.
  std::set<int32_t> skipping;
  /// SHA-256 of the files of its scene, once a worker has fetched one.
  std::set<std::string> scene_files;
  /// The file that is missing or damaged, which the job waits for.
  std::optional<v1::AssetRef> wanted_asset;
};

/// A job that has ended, whose end is being recorded.
struct EndingJob {
  /// With the end.
  ledger::JobRecord record;
  /// What clients see until the end is recorded.
  v1::JobStatus shown;
  /// Who waits for it.
  std::vector<StatusAnswer> cancels;
};

/// A job that is being changed: neither the scheduler nor the committer nor the finisher has anything of it.
struct SuspendedJob {
  /// What clients see meanwhile.
  v1::JobStatus shown;
  bool committer_is_done = false;
};

/// The jobs that a coordinator has in memory, each in one state. Pure state.
/// Threads: one at a time.
class JobTable {
 public:
  ActiveJob* FindActive(const job::JobId& job);
  const ActiveJob* FindActive(const job::JobId& job) const;
  const std::map<job::JobId, ActiveJob>& active() const { return active_; }
  /// The job must not be in memory.
  ActiveJob* Activate(ledger::JobRecord record);
  /// Ends being active; nullopt if it is not.
  std::optional<ActiveJob> TakeActive(const job::JobId& job);

  EndingJob* FindEnding(const job::JobId& job);
  const EndingJob* FindEnding(const job::JobId& job) const;
  std::vector<job::JobId> Ending() const;
  void AddEnding(const job::JobId& job, EndingJob ending) { ending_.emplace(job, std::move(ending)); }
  /// The job must be ending.
  EndingJob TakeEnding(const job::JobId& job);

  SuspendedJob* FindSuspended(const job::JobId& job);
  const SuspendedJob* FindSuspended(const job::JobId& job) const;
  void Suspend(const job::JobId& job, v1::JobStatus shown) { suspended_[job] = {.shown = std::move(shown)}; }
  void EndSuspension(const job::JobId& job) { suspended_.erase(job); }

  bool IsInMemory(const job::JobId& job) const {
    return active_.contains(job) || ending_.contains(job) || suspended_.contains(job);
  }
  /// SHA-256 of the files that active jobs wait for, and the jobs that wait for one. Linear.
  std::set<std::string> WantedAssets() const;
  std::vector<job::JobId> WaitingForAsset(const std::string& sha256) const;
  /// Jobs of a user that have not ended. Linear.
  int64_t CountOf(const std::string& user) const;

 private:
  std::map<job::JobId, ActiveJob> active_;
  std::map<job::JobId, EndingJob> ending_;
  std::map<job::JobId, SuspendedJob> suspended_;
};

/// Submissions that are not jobs yet. Pure state.
/// Threads: one at a time.
class SubmissionTable {
 public:
  /// Counts a submission of the user until End, unless it has `limit` with these jobs.
  bool Begin(const std::string& user, int64_t jobs, int limit);
  void End(const std::string& user);

  /// A submission ended with an error of the ledger, which may have recorded the job.
  void AddUncertain(const job::JobId& job) { uncertain_.insert(job); }
  bool IsUncertain(const job::JobId& job) const { return uncertain_.contains(job); }
  /// Whether it was uncertain.
  bool Forget(const job::JobId& job) { return uncertain_.erase(job) > 0; }
  const std::set<job::JobId>& uncertain() const { return uncertain_; }

 private:
  std::map<std::string, int> running_;
  std::set<job::JobId> uncertain_;
};

}  // namespace lumifold::server
