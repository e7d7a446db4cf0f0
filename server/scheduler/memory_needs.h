#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"

namespace lumifold::scheduler {

/// What memory jobs need: by their plan, and more than what a worker has that ran out of it, for a while,
/// since something else may have taken it. Pure state. Time: O(log n) a call.
/// Threads: one at a time.
class MemoryNeeds {
 public:
  struct Need {
    uint64_t planned = 0;
    /// The most that was too little lately, and whose; empty: none.
    uint64_t too_little = 0;
    std::string worker;
    absl::Time until = absl::InfiniteFuture();

    /// Memory that a worker needs to get a unit.
    uint64_t bytes() const;
  };

  void SetPlanned(int64_t job, uint64_t bytes) { needs_[job].planned = bytes; }
  /// The worker with so much memory ran out of it. Holds until `until`.
  void RanOut(int64_t job, const std::string& worker, uint64_t bytes, absl::Time until);
  const Need& Of(int64_t job) const { return needs_.at(job); }
  /// Jobs for which what RanOut said is over at `now`; it is forgotten.
  std::vector<int64_t> TakeEnded(absl::Time now);
  absl::Time NextEnd() const { return ends_.empty() ? absl::InfiniteFuture() : ends_.begin()->first; }
  void EndJob(int64_t job);

 private:
  void Forget(int64_t job, Need* need);

  std::map<int64_t, Need> needs_;
  std::set<std::pair<absl::Time, int64_t>> ends_;
};

}  // namespace lumifold::scheduler
