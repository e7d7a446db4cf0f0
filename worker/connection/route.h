#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "proto/retry/schedule.h"
#include "proto/rpc/reconnect_pauses.h"

namespace lumifold::worker {

/// Which coordinator a worker connects to next: those of its list in turn, the first one first, and one that
/// it was sent to before all others. The pauses, rpc::kReconnectPauses, begin once all of the list have been
/// tried.
/// Threads: one at a time.
class Route {
 public:
  /// `endpoints` must not be empty. `jitter`: see retry::Schedule.
  Route(std::vector<std::string> endpoints, std::function<double()> jitter)
      : endpoints_(std::move(endpoints)), schedule_(rpc::kReconnectPauses, std::move(jitter)) {}

  /// The address to connect to.
  const std::string& current() const { return sent_to_.empty() ? endpoints_[index_] : sent_to_; }
  /// Whether there is no other.
  bool IsOnly() const { return endpoints_.size() == 1 && sent_to_.empty(); }
  size_t size() const { return endpoints_.size(); }

  /// The connection to current() has ended, or there was none; `was_steady` if it had lasted. Goes on to the
  /// next and returns the pause before it.
  absl::Duration Leave(bool was_steady);
  /// The coordinator has sent the worker to `address`.
  void MoveTo(std::string address);

 private:
  const std::vector<std::string> endpoints_;
  retry::Schedule schedule_;
  size_t index_ = 0;
  size_t tried_ = 0;     // since the last pause or steady connection
  std::string sent_to_;  // not in the list; empty: none
};

}  // namespace lumifold::worker
