#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "absl/types/span.h"
#include "server/ledger/roster.h"

namespace lumifold::cluster {

/// Workers that a coordinator is to send to another one.
struct WorkerMove {
  int64_t workers = 0;
  /// Of the coordinator that gets them.
  std::string address;

  friend bool operator==(const WorkerMove&, const WorkerMove&) = default;
};

/// What the member `self` gives to the one that lacks most, so that all jobs of a farm get the same number of
/// slots, whichever coordinator owns them, as far as they demand them. Pure. Each coordinator decides alone,
/// from figures that may be a second old: it gives only what it has beyond its share, whole workers, and asks
/// for nothing. One that has jobs and no worker gets one, where another coordinator has two. nullopt:
/// nothing.
std::optional<WorkerMove> FindMove(absl::Span<const ledger::Member> members, ledger::Epoch self);

}  // namespace lumifold::cluster
