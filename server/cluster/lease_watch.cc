#include "server/cluster/lease_watch.h"

#include <utility>

namespace lumifold::cluster {

std::vector<ledger::Member> LeaseWatch::Expired(absl::Span<const ledger::Member> members, absl::Time now) {
  if (now - std::exchange(last_read_, now) >= lease_ / 2) seen_.clear();
  std::map<ledger::Epoch, Seen> seen;
  std::vector<ledger::Member> expired;
  for (const ledger::Member& member : members) {
    const auto before = seen_.find(member.owner.epoch);
    const bool stands_still = before != seen_.end() && before->second.renewals == member.renewals;
    const Seen entry{member.renewals, stands_still ? before->second.since : now};
    if (now - entry.since >= lease_) expired.push_back(member);
    seen.emplace(member.owner.epoch, entry);
  }
  seen_ = std::move(seen);
  return expired;
}

}  // namespace lumifold::cluster
