#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "absl/time/time.h"
#include "absl/types/span.h"
#include "server/ledger/roster.h"

namespace lumifold::cluster {

/// Finds out which coordinators are dead: those whose renewals, as this coordinator has read them, stood
/// still for a lease. Pure: time is an argument. No two clocks are compared: each member measures with its
/// own monotonic clock. What it concludes decides only when jobs change hands; that they have one owner is up
/// to the store.
/// Threads: one at a time.
class LeaseWatch {
 public:
  explicit LeaseWatch(absl::Duration lease) : lease_(lease) {}

  /// Takes the members as read at `now`, and returns those whose leases have expired, by epoch. After a pause
  /// between two reads of half a lease or more every lease begins anew: it was this coordinator that was
  /// stopped, or the database, without which nobody could renew.
  std::vector<ledger::Member> Expired(absl::Span<const ledger::Member> members, absl::Time now);

 private:
  struct Seen {
    int64_t renewals = 0;
    absl::Time since;
  };

  const absl::Duration lease_;
  absl::Time last_read_ = absl::InfinitePast();
  std::map<ledger::Epoch, Seen> seen_;
};

}  // namespace lumifold::cluster
