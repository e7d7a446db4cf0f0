#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "absl/time/time.h"
#include "server/job/ids.h"

namespace lumifold::server {

struct RetentionLimits {
  /// Bytes of unit logs that are not needed any more and are kept for added samples and repeated units. 0:
  /// none.
  uint64_t film_bytes = uint64_t{10'000'000'000};
  /// Film is removed while less than this is free on the disk.
  uint64_t free_bytes = uint64_t{2} << 30;
  /// Bytes of film, results, assets and uploads together; nullopt: no limit.
  std::optional<uint64_t> quota_bytes;
  /// A job is deleted this long after its end.
  absl::Duration keep_results = absl::InfiniteDuration();
};

/// What is removed next.
struct Removal {
  enum class What {
    kJob,    // a job that has ended: its row, results and film
    kFilm,   // the film of a job that has ended
    kFrame,  // the unit log of a finished frame of an active job
  };
  What what = What::kJob;
  job::JobId job;
  int32_t frame = 0;  // of kFrame
  /// Why, for the log: one line.
  std::string cause;
};

/// Decides which films and jobs go when there is too much of them. Pure state: no clock, no disk. The film of
/// an unfinished frame of an active job is never removed, nor are the results of an active job.
///
/// Order: films before results; films of ended jobs before those of active ones; within each, the oldest end
/// first, and of equal ones the lower id.
/// Time: O(log n) for each call; n counts ended jobs and finished frames of active jobs.
/// Threads: one at a time.
class Retention {
 public:
  explicit Retention(const RetentionLimits& limits) : limits_(limits) {}

  /// A job has ended, or what it has on the disk was measured again. Forgets its single frames.
  void JobEnded(const job::JobId& job, absl::Time ended, uint64_t film_bytes, uint64_t result_bytes);
  /// A frame of an active job is finished; its unit log is not needed for the job to go on.
  void FrameFinished(const job::JobId& job, int32_t frame, absl::Time finished, uint64_t film_bytes);
  /// What all else uses: assets, uploads, films of unfinished frames and results of active jobs.
  void SetOtherBytes(uint64_t bytes) { other_bytes_ = bytes; }
  /// The job was deleted or runs again. No effect on a job that is not known.
  void Forget(const job::JobId& job);
  /// The film of a job that has ended is gone.
  void FilmRemoved(const job::JobId& job);
  /// The unit log of a frame of an active job is gone, or the frame is not finished any more.
  void FrameRemoved(const job::JobId& job, int32_t frame);
  /// Jobs that are kept whatever their age, because others wait for them; replaces the set.
  void SetNeeded(std::set<job::JobId> jobs) { needed_ = std::move(jobs); }

  /// What goes next; nullopt if everything is within its limits or nothing may go. The caller removes it and
  /// reports that before it asks again. `free_bytes` are those of the disk.
  std::optional<Removal> Next(absl::Time now, uint64_t free_bytes) const;

  uint64_t film_bytes() const { return film_bytes_; }
  uint64_t used_bytes() const { return film_bytes_ + result_bytes_ + other_bytes_; }
  const RetentionLimits& limits() const { return limits_; }

 private:
  struct EndedJob {
    absl::Time ended;
    uint64_t film_bytes = 0;
    uint64_t result_bytes = 0;
  };
  struct FinishedFrame {
    absl::Time finished;
    uint64_t film_bytes = 0;
  };
  using FrameKey = std::pair<job::JobId, int32_t>;

  std::optional<Removal> OldestFilm(std::string cause) const;
  std::optional<Removal> OldestJob(std::string cause) const;

  const RetentionLimits limits_;
  uint64_t film_bytes_ = 0;
  uint64_t result_bytes_ = 0;
  uint64_t other_bytes_ = 0;
  std::map<job::JobId, EndedJob> jobs_;
  std::map<FrameKey, FinishedFrame> frames_;
  std::set<std::pair<absl::Time, job::JobId>> by_end_;
  std::set<std::pair<absl::Time, job::JobId>> films_by_end_;  // jobs that have a film
  std::set<std::pair<absl::Time, FrameKey>> frames_by_end_;
  std::set<job::JobId> needed_;
};

}  // namespace lumifold::server
