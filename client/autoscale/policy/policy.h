#pragma once

#include <string>
#include <vector>

#include "absl/time/time.h"
#include "client/autoscale/policy/history.h"
#include "client/autoscale/policy/types.h"

namespace lumifold::autoscale {

/// A request to end, and why.
struct Release {
  std::string id;
  std::string why;
};

struct Decision {
  /// Workers that the farm should have from the engine, within the limits.
  int wanted = 0;
  /// Requests that count: pending and running ones without duplicates.
  int pending = 0;
  int running = 0;
  int start = 0;
  std::vector<Release> release;
  /// In one line: what is wanted, what is there, and what stands in the way.
  std::string reason;
};

/// One step: what to start and to release now. `history` is brought up to date.
///
///   wanted   units x seconds a unit / (slots of a worker x finish_within), at most one worker for each
///            `slots` units, in all users together, each within per_user; less what workers from elsewhere
///            do; between minimum and maximum. Until a unit was measured it is taken for 2 s, the least that
///            plans give a unit.
///   start    wanted - pending - running, at most starts_at_a_time; within the budget; after a refusal or a
///            death at start nothing until the pause is over, then one at a time until it lives.
///   release  duplicates; then, while there are more than wanted: pending requests, and workers that are idle
///            for `idle`, longest idle first. Blocked workers, and requests that never joined. All, once the
///            budget is spent. A released worker gets SIGTERM: it finishes or hands back its units.
/// Pure: the same arguments give the same decision.
Decision Decide(absl::Time now, const FarmState& farm, const EngineState& engine, const Limits& limits,
                const Tuning& tuning, History* history);

/// The engine took a start, or refused it.
void OnStarted(History* history);
void OnRefused(absl::Time now, const std::string& error, History* history);

}  // namespace lumifold::autoscale
