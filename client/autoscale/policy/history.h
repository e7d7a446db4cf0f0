#pragma once

#include <map>
#include <set>
#include <string>

#include "absl/time/time.h"
#include "client/autoscale/policy/types.h"

namespace lumifold::autoscale {

/// Failures in a row, and the pause after the last one.
struct Backoff {
  int failures = 0;
  absl::Time last = absl::InfinitePast();
  std::string why = {};

  void Fail(absl::Time now, const std::string& reason);
  /// When the next start may be tried; in the past without failures.
  absl::Time NextTry(const Tuning& tuning) const;
};

/// Core-seconds of one request in the budget's period.
struct Charge {
  double cores = 0;
  absl::Time from = {};   // its start, or that of the period
  absl::Time until = {};  // of the last look at which it ran
  double CoreSeconds() const { return cores * absl::ToDoubleSeconds(until - from); }
};

/// What the policy has to remember. All of it but `seen` is kept over restarts
/// (client/autoscale/state_file.h).
struct History {
  Backoff refusals;
  Backoff deaths;
  /// Ended requests whose end was counted, by id and start, while the engine still shows them.
  std::set<std::string> counted_ends;
  absl::Time period_start = absl::InfinitePast();
  double spent_core_seconds = 0;  // of requests that have ended
  std::map<std::string, Charge> charges;
  double seconds_per_unit = 0;  // of the last workers; 0: not known

  /// From look to look only: after a restart the times of idle workers begin again.
  struct Seen {
    std::map<std::string, absl::Time> idle_since;    // by request
    std::map<std::string, absl::Time> absent_since;  // requests that run without a connected worker
    std::set<std::string> joined;                    // requests whose worker was connected once
  } seen;

  double UsedCoreSeconds() const;
};

/// Charges the requests that run. A request that is no longer shown is charged until now: the budget may be
/// charged for the time between two looks too much, and never too little.
void ChargeRequests(absl::Time now, const EngineState& engine, const Limits& limits, History* history);

/// Counts requests that died at their start, once each, all of one look as one failure; ends the backoff once
/// a worker has lived longer than that.
void CountDeaths(absl::Time now, const EngineState& engine, const Tuning& tuning, History* history);

}  // namespace lumifold::autoscale
