#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "absl/time/time.h"
#include "server/scheduler/fair_share.h"
#include "server/scheduler/memory_needs.h"
#include "server/scheduler/types.h"
#include "server/scheduler/worker_pool.h"

namespace lumifold::scheduler {

enum class Readiness {
  kNone,        // no free unit, or none that may be leased now
  kUnit,        // a free unit of an active frame
  kOpensFrame,  // free units of frames that are not active only
};

/// Which jobs have units to give, to which workers, and whose turn it is. Pure state. Time: O(log n) for each
/// call, and for each distinct pair of class and tags that ready jobs require where it concerns workers.
///
/// Order: users and priorities by fair share and jobs of these by their turns (fair_share.h), except that a
/// worker goes on with the job whose scene it has loaded while that is its user's first one and not far ahead
/// of its share, and that no user's first job waits for ever.
///
/// Frames in flight: a frame is active from the first lease or committed unit until its result is written.
/// Frames count against SetMaxActiveFrames while their job is not paused and a worker that may render it is
/// available: all of these can be finished, so that the limit cannot stop the farm.
///
/// Threads: one at a time.
class ReadyJobs {
 public:
  /// `workers` must outlive it.
  ReadyJobs(const SchedulerOptions& options, const WorkerPool* workers);

  /// Adds a job with a new number; it is not ready, and has no active frames.
  void Add(int64_t job, const JobOptions& options);
  /// Here and below the job is known. Its active frames no longer count.
  void Remove(int64_t job);
  void SetPriority(int64_t job, int priority) { share_.SetPriority(job, priority); }
  void SetTurn(int64_t job, int64_t turn) { share_.SetTurn(job, turn); }
  const Requirement& RequirementOf(int64_t job) const { return entries_.at(job).demand->first; }
  /// Changes what the job requires; it is not ready then. Its active frames do not count at the time.
  void SetRequirement(int64_t job, const Requirement& requirement, absl::Time now);
  void Set(int64_t job, Readiness readiness, absl::Time now);
  Readiness Get(int64_t job) const { return entries_.at(job).readiness; }

  /// Changes the number of active frames of jobs that are not paused.
  void CountFrames(int64_t job, int change);
  /// Units of a further frame are leased only while fewer frames than this are active; >= 1. No limit before
  /// the first call.
  void SetMaxActiveFrames(int frames);
  int max_active_frames() const { return max_active_frames_; }
  /// Frames that count against SetMaxActiveFrames.
  int active_frames() const;
  bool MayOpenFrame() const { return live_frames_ < max_active_frames_; }
  /// To be called before units are leased: workers may have come or gone.
  void FollowWorkers();

  /// Whether a job is ready for workers of this kind.
  bool HasAny(const Requirement& kind) const;
  /// The job whose unit the worker is to get next, except those in `passed`.
  std::optional<int64_t> Next(const Worker& worker, const std::set<int64_t>& passed, absl::Time now);
  /// The job has got a lease.
  void Granted(int64_t job, absl::Time now);
  /// A lease of the job has ended after `slot_time`.
  void Ended(int64_t job, absl::Duration slot_time) { share_.Ended(job, slot_time); }

  const FairShare& share() const { return share_; }
  /// Of all jobs that are here. Whoever changes one sets the job's requirement.
  MemoryNeeds& memory() { return memory_; }
  const MemoryNeeds& memory() const { return memory_; }

 private:
  /// The jobs that need the same workers.
  struct Demand {
    int jobs = 0;
    int active_frames = 0;  // of jobs that are not paused
    FairShare::Queue with_unit;
    FairShare::Queue opening_frame;
  };
  using Demands = std::map<Requirement, Demand>;
  struct Entry {
    Demands::iterator demand;
    Readiness readiness = Readiness::kNone;
  };

  Demands::iterator Enter(const Requirement& requirement);
  void Leave(int64_t job, absl::Time now);

  const FairShare::Tolerance locality_;
  const absl::Duration longest_wait_;
  const WorkerPool* const workers_;
  FairShare share_;
  MemoryNeeds memory_;
  Demands demands_;
  std::map<int64_t, Entry> entries_;
  int64_t grants_ = 0;
  int max_active_frames_ = std::numeric_limits<int>::max();
  int live_frames_ = 0;        // active frames that can be finished
  int64_t counted_kinds_ = 0;  // the pool's version at which they were counted
};

}  // namespace lumifold::scheduler
