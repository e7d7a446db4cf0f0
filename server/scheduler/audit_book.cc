#include "server/scheduler/audit_book.h"

#include <algorithm>
#include <cstddef>

namespace lumifold::scheduler {
namespace {

/// Audits that are looked at for one worker: it may not audit itself.
constexpr int kMaxAuditsLooked = 8;

/// Workers that render an audited unit. If no two of them agree, the machines' arithmetic differs, and no
/// majority will tell who is right.
constexpr size_t kMaxVotes = 5;

}  // namespace

AuditBook::Audit* AuditBook::Find(const UnitIndex& unit) {
  const auto job = jobs_.find(unit.job);
  if (job == jobs_.end()) return nullptr;
  const auto audit = job->second.audits.find(unit.place);
  return audit == job->second.audits.end() ? nullptr : &audit->second;
}

bool AuditBook::Begin(const UnitIndex& unit, const std::string& worker, absl::string_view digest,
                      absl::Time now) {
  JobAudits& job = jobs_[unit.job];
  if (digest.empty() || worker.empty()) {
    ++job.waived;
    return false;
  }
  job.audits[unit.place].votes.push_back({worker, std::string(digest)});
  Extend(unit, now);
  Return(unit);
  return true;
}

bool AuditBook::End(const UnitIndex& unit) {
  const Audit* audit = Find(unit);
  if (audit == nullptr) return false;
  JobAudits& job = jobs_.at(unit.job);
  job.ready.erase({static_cast<int>(audit->votes.size()), unit.place});
  job.audits.erase(unit.place);
  return true;
}

bool AuditBook::HasOpen(int64_t job, int frame) const {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return false;
  const auto first = found->second.audits.lower_bound({frame, 0});
  return first != found->second.audits.end() && first->first.frame == frame;
}

bool AuditBook::HasReady(int64_t job) const {
  const auto found = jobs_.find(job);
  return found != jobs_.end() && !found->second.ready.empty();
}

std::optional<Place> AuditBook::Take(int64_t job, const std::string& worker) {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return std::nullopt;
  std::set<std::pair<int, Place>>& ready = found->second.ready;
  int looked = 0;
  for (auto it = ready.begin(); it != ready.end() && looked < kMaxAuditsLooked; ++it, ++looked) {
    const Place place = it->second;
    Audit& audit = found->second.audits.at(place);
    const bool has_voted = std::any_of(audit.votes.begin(), audit.votes.end(),
                                       [&](const Ballot& vote) { return vote.worker == worker; });
    if (has_voted || audit.declined.contains(worker)) continue;
    ready.erase(it);
    audit.leased = true;
    return place;
  }
  return std::nullopt;
}

bool AuditBook::Return(const UnitIndex& unit) {
  Audit* audit = Find(unit);
  if (audit == nullptr) return false;
  audit->leased = false;
  jobs_.at(unit.job).ready.emplace(static_cast<int>(audit->votes.size()), unit.place);
  return true;
}

void AuditBook::Decline(const UnitIndex& unit, const std::string& worker) {
  jobs_.at(unit.job).audits.at(unit.place).declined.insert(worker);
}

AuditBook::Verdict AuditBook::Vote(const UnitIndex& unit, const std::string& worker, absl::string_view digest,
                                   absl::Time now) {
  JobAudits& job = jobs_.at(unit.job);
  Audit& audit = job.audits.at(unit.place);
  audit.votes.push_back({worker, std::string(digest)});
  const std::vector<Ballot>& votes = audit.votes;
  const auto right = std::find_if(votes.begin(), votes.end(), [&](const Ballot& vote) {
    return std::count_if(votes.begin(), votes.end(),
                         [&](const Ballot& other) { return other.digest == vote.digest; }) >= 2;
  });
  if (right == votes.end()) {
    if (votes.size() >= kMaxVotes) {
      ++job.waived;
      return {.outcome = Outcome::kUndecided, .wrong = {}};
    }
    Extend(unit, now);
    Return(unit);
    return {};
  }
  ++job.settled;
  Verdict verdict{.outcome = Outcome::kSettled, .wrong = {}};
  for (const Ballot& vote : votes) {
    if (vote.digest != right->digest) verdict.wrong.push_back(vote.worker);
  }
  return verdict;
}

std::vector<UnitIndex> AuditBook::TakeDue(absl::Time now) {
  std::vector<UnitIndex> due;
  while (!deadlines_.empty() && deadlines_.begin()->first <= now) {
    const auto [deadline, unit] = *deadlines_.begin();
    deadlines_.erase(deadlines_.begin());
    const Audit* audit = Find(unit);
    if (audit != nullptr && audit->deadline == deadline) due.push_back(unit);
  }
  return due;
}

absl::Time AuditBook::NextDue() const {
  return deadlines_.empty() ? absl::InfiniteFuture() : deadlines_.begin()->first;
}

void AuditBook::Extend(const UnitIndex& unit, absl::Time now) {
  jobs_.at(unit.job).audits.at(unit.place).deadline = now + patience_;
  deadlines_.emplace(now + patience_, unit);
}

void AuditBook::Waive(const UnitIndex& unit) {
  ++jobs_.at(unit.job).waived;
  End(unit);
}

bool AuditBook::IsLeased(const UnitIndex& unit) const { return Get(unit).leased; }

std::set<std::string> AuditBook::AskedOf(const UnitIndex& unit) const {
  const Audit& audit = Get(unit);
  std::set<std::string> asked = audit.declined;
  for (const Ballot& vote : audit.votes) asked.insert(vote.worker);
  return asked;
}

AuditBook::Counts AuditBook::CountsOf(int64_t job) const {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return {};
  return {static_cast<int64_t>(found->second.audits.size()), found->second.settled, found->second.waived};
}

}  // namespace lumifold::scheduler
