#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "proto/threads/task_thread.h"
#include "server/assets/asset_store.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"
#include "server/storage/disk_space.h"
#include "server/storage/retention.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

struct JanitorOptions {
  RetentionLimits limits;
  /// Monotonic clock.
  std::function<absl::Time()> now;
  /// Wall clock: the ages of jobs are counted over restarts, by the times of their files.
  std::function<absl::Time()> wall_now;
  std::function<DiskSpace()> disk;
  std::shared_ptr<spdlog::logger> log;
};

/// Removes from the data folder what is no longer needed: films, results and rows of jobs that have ended, as
/// Retention decides and clients ask; assets that no job refers to; uploads that broke long ago. It works in
/// steps on `thread`, and deletes files on `deleter`, which may be of the lowest priority: it takes no lock
/// there.
///
/// A deletion survives any crash: it is recorded in the folder deleted/ first, and a janitor that starts
/// completes what it finds there.
/// Threads: safe. Calls only queue, except where they say otherwise.
class Janitor {
 public:
  /// `store`, `assets` and the threads must outlive it; the threads are stopped first.
  Janitor(JanitorOptions options, const DataFolder& folder, ledger::JobStore* store, AssetStore* assets,
          threads::TaskThread* thread, threads::TaskThread* deleter);

  /// Looks for what an earlier run has left. Call it once, when the unfinished jobs are known.
  void Start();
  /// Looks whether there is anything to do, because time has passed.
  void Poke();
  /// The end of a job is recorded: its manifest is moved, and from now on its film, and later all of it, may
  /// go.
  void JobEnded(const job::JobId& job, v1::JobState state, const std::string& error);
  /// The result of a frame of an active job is recorded: its unit log may go.
  void FrameFinished(const job::JobId& job, int32_t frame);
  /// A job is about to run again: nothing of it is changed until the next JobEnded or FrameFinished. Blocks
  /// while something of it is being removed.
  void Keep(const job::JobId& job);
  /// Deletes a job that has ended. Its row is gone when the call returns; its files go soon after. Blocks on
  /// the disk.
  /// Errors: those of JobStore::DeleteJob; kUnavailable naming a file that cannot be written.
  absl::Status Delete(const job::JobId& job);
  /// Jobs that others wait for: they are not deleted because of their age or the quota.
  void SetNeeded(std::set<job::JobId> jobs);

  /// Errors: kResourceExhausted with the numbers where the quota is used up by what cannot be removed.
  absl::Status CheckQuota() const;
  /// Bytes that uploads may take at this moment.
  uint64_t Room() const;

 private:
  /// A job that has ended, to be registered.
  struct EndedJob {
    job::JobId job;
    v1::JobState state = v1::JOB_STATE_UNSPECIFIED;
    std::string error;
  };
  struct FinishedFrame {
    job::JobId job;
    int32_t frame = 0;
  };
  /// Removes the files of a job that has no row, and then the record of its deletion.
  struct CompleteDeletion {
    job::JobId job;
  };
  struct Sweep {};
  using Files = absl::StatusOr<std::vector<std::string>>;
  using Work = std::variant<EndedJob, FinishedFrame, CompleteDeletion, Sweep, Removal>;

  void Queue(Work work);
  void Step();
  // Each does a step, except for the deletion of files, which it returns.
  /// Ends a step whose files are deleted, or could not be.
  void Finish(const Work& work, const absl::Status& status);
  /// The next thing to do now; nullopt if there is none.
  std::optional<Work> FindWork(const DiskSpace& disk) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Files Do(const EndedJob& ended);
  Files Do(const FinishedFrame& finished);
  Files Do(const CompleteDeletion& deletion);
  Files Do(const Sweep& sweep);
  Files Do(const Removal& removal);
  /// Removes a job for ever: records the deletion, then removes the row. Its files are left to
  /// CompleteDeletion.
  absl::Status BeginDeletion(const job::JobId& job);
  /// A removal is done.
  void Count(const Removal& removal) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void FindEndedJobs();
  void FindDeletions();
  absl::StatusOr<std::set<std::string>> ReferencedAssets();

  const JanitorOptions options_;
  const DataFolder folder_;
  ledger::JobStore* const store_;
  AssetStore* const assets_;
  threads::TaskThread* const thread_;
  threads::TaskThread* const deleter_;

  mutable absl::Mutex mutex_;
  absl::CondVar step_done_;
  bool is_working_ ABSL_GUARDED_BY(mutex_) = false;
  Retention retention_ ABSL_GUARDED_BY(mutex_);
  std::deque<Work> queue_ ABSL_GUARDED_BY(mutex_);
  /// The job that a step works on.
  std::optional<job::JobId> current_ ABSL_GUARDED_BY(mutex_);
  absl::Time next_sweep_ ABSL_GUARDED_BY(mutex_);
  /// After a failure: no removal before this time.
  absl::Time not_before_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  uint64_t other_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace lumifold::server
