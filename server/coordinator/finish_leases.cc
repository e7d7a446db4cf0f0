#include "server/coordinator/finish_leases.h"

#include <algorithm>
#include <set>
#include <utility>

namespace lumifold::server {
namespace {

using job::Attempt;
using job::WorkerId;

/// For each pixel four times what the filter takes, in which no progress can be seen.
constexpr absl::Duration kFilterOfAPixel = absl::Microseconds(42);
/// A frame of one block takes a slow machine a few minutes.
constexpr absl::Duration kLongest = absl::Minutes(30);
constexpr absl::Duration kExcluded = absl::Minutes(5);

}  // namespace

void FinishLeases::AddWorker(WorkerId worker, const FinishOffer& offer) {
  if (offer.places > 0) offers_[worker] = {offer, offer};
}

std::vector<Attempt> FinishLeases::RemoveWorker(WorkerId worker) {
  offers_.erase(worker);
  std::vector<Attempt> ended;
  for (const auto& [attempt, lease] : leases_) {
    if (lease.worker == worker && !lease.is_delivered) ended.push_back(attempt);
  }
  return ended;
}

std::optional<WorkerId> FinishLeases::FindPlace(const std::string& numeric_class, uint64_t memory_bytes,
                                                absl::FunctionRef<bool(WorkerId)> is_available) const {
  std::optional<WorkerId> best;
  int places = 0;
  for (const auto& [worker, offer] : offers_) {
    const FinishOffer& left = offer.left;
    if (left.places <= places || left.memory_bytes < memory_bytes || left.numeric_class != numeric_class ||
        !is_available(worker))
      continue;
    best = worker;
    places = left.places;
  }
  return best;
}

bool FinishLeases::HasOffer(const std::string& numeric_class, uint64_t memory_bytes,
                            absl::FunctionRef<bool(WorkerId)> is_available) const {
  return std::any_of(offers_.begin(), offers_.end(), [&](const auto& entry) {
    const FinishOffer& whole = entry.second.whole;
    return whole.memory_bytes >= memory_bytes && whole.numeric_class == numeric_class &&
           is_available(entry.first);
  });
}

void FinishLeases::Grant(Attempt attempt, FinishLease lease, absl::Time now) {
  FinishOffer& offer = offers_.at(lease.worker).left;
  lease.party = offer.party;
  --offer.places;
  offer.memory_bytes -= lease.memory_bytes;
  lease.granted = lease.heard = lease.progressed = now;
  leases_.emplace(attempt, std::move(lease));
}

FinishLease* FinishLeases::Find(WorkerId worker, const FramePart& part, Attempt attempt) {
  const auto found = leases_.find(attempt);
  if (found == leases_.end() || found->second.worker != worker || !(found->second.part == part))
    return nullptr;
  return &found->second;
}

FinishLease FinishLeases::End(Attempt attempt) {
  FinishLease lease = std::move(leases_.extract(attempt).mapped());
  if (const auto offer = offers_.find(lease.worker); offer != offers_.end()) {
    ++offer->second.left.places;
    offer->second.left.memory_bytes += lease.memory_bytes;
  }
  return lease;
}

std::vector<Attempt> FinishLeases::OfJob(const job::JobId& job) const {
  std::vector<Attempt> found;
  for (const auto& [attempt, lease] : leases_) {
    if (lease.part.frame.first == job) found.push_back(attempt);
  }
  return found;
}

std::vector<Attempt> FinishLeases::Heartbeat(WorkerId worker, absl::Span<const scheduler::HeldLease> held,
                                             Attempt newest, absl::Time now) {
  std::map<Attempt, int64_t> progress;
  for (const scheduler::HeldLease& lease : held) progress.emplace(lease.attempt, lease.progress);
  std::vector<Attempt> dropped;
  for (auto& [attempt, lease] : leases_) {
    if (lease.worker != worker || lease.is_delivered) continue;
    const auto named = progress.find(attempt);
    if (named != progress.end()) {
      lease.heard = now;
      if (std::exchange(lease.progress, named->second) != named->second) lease.progressed = now;
    } else if (attempt <= newest) {
      dropped.push_back(attempt);
    }
  }
  return dropped;
}

void FinishLeases::Exclude(const std::string& party, const job::JobId& job, absl::Time now) {
  for (auto& [other, parties] : excluded_)
    std::erase_if(parties, [now](const auto& entry) { return entry.second <= now; });
  std::erase_if(excluded_, [](const auto& entry) { return entry.second.empty(); });
  std::set<std::string> offering;
  for (const auto& [worker, offer] : offers_) offering.insert(offer.whole.party);
  const auto excluded = excluded_.find(job);
  const size_t count = excluded == excluded_.end() ? 0 : excluded->second.size();
  if (count == 0 || 2 * count < offering.size()) excluded_[job][party] = now + kExcluded;
}

bool FinishLeases::IsExcluded(WorkerId worker, const job::JobId& job, absl::Time now) const {
  const auto excluded = excluded_.find(job);
  if (excluded == excluded_.end()) return false;
  const auto until = excluded->second.find(offers_.at(worker).whole.party);
  return until != excluded->second.end() && now < until->second;
}

std::vector<Attempt> FinishLeases::Expired(absl::Time now,
                                           absl::FunctionRef<bool(WorkerId)> is_blocked) const {
  std::vector<Attempt> expired;
  for (const auto& [attempt, lease] : leases_) {
    const absl::Duration standstill = lease_ + static_cast<double>(lease.pixels) * kFilterOfAPixel;
    const absl::Time end =
        std::min({lease.heard + lease_, lease.progressed + standstill, lease.granted + kLongest});
    if ((end <= now || is_blocked(lease.worker)) && !lease.is_delivered) expired.push_back(attempt);
  }
  return expired;
}

}  // namespace lumifold::server
