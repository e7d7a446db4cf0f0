#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "server/job/ids.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// The frames whose units all go to one worker, which keeps them. Pure state. Time: O(log n) a call and for
/// each frame of the worker or job that it names.
///
/// Threads: one at a time.
class KeptFrames {
 public:
  /// Number of the job, index of the frame.
  using Frame = std::pair<int64_t, int>;
  /// What a worker keeps.
  struct Load {
    int frames = 0;
    uint64_t bytes = 0;
  };

  /// The worker keeps a frame of so many units, none of which is leased. `bytes`: what its records take.
  void Open(const Frame& frame, job::WorkerId keeper, int64_t units, uint64_t bytes);
  /// No effect on a frame that is not kept.
  void Close(const Frame& frame);
  void CloseJob(int64_t job);

  bool Has(const Frame& frame) const { return frames_.contains(frame); }
  std::optional<job::WorkerId> KeeperOf(const Frame& frame) const;
  int CountOf(int64_t job) const;
  Load LoadOf(job::WorkerId worker) const;
  /// Whether units of the job's kept frames were never leased.
  bool HasUnleased(int64_t job) const;
  /// Takes the next of them that the worker is to get.
  std::optional<Place> TakeNext(int64_t job, job::WorkerId worker);

  /// Frames that can be kept no longer, until TakeBroken: all of a worker, of a job, or of both.
  void BreakOf(job::WorkerId worker);
  void BreakOf(int64_t job);
  void BreakOf(int64_t job, job::WorkerId worker);
  std::vector<Frame> TakeBroken();

 private:
  struct Kept {
    job::WorkerId keeper{};
    int64_t next = 0;  // units from here on were never leased
    int64_t units = 0;
    uint64_t bytes = 0;
  };
  using Frames = std::map<Frame, Kept>;

  Frames::const_iterator FirstOf(int64_t job) const { return frames_.lower_bound({job, 0}); }

  Frames frames_;
  std::map<job::WorkerId, std::set<Frame>> by_worker_;  // never empty
  std::set<Frame> broken_;
};

}  // namespace lumifold::scheduler
