// Audits: a share of the units is rendered by a second worker, to find workers that deliver wrong pixels.
#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::UnitRef;
using job::WorkerId;

namespace {

/// Audits that are looked at for one worker: it may not audit itself.
constexpr int kMaxAuditsLooked = 8;

/// Workers that render an audited unit. If no two of them agree, the machines' arithmetic differs, and no
/// majority will tell who is right.
constexpr size_t kMaxVotes = 5;

/// FNV-1a, 64 bits: the choice of units must be the same in every run and on every machine.
uint64_t HashOf(const UnitRef& unit) {
  const std::string text = job::Describe(unit);
  uint64_t hash = 14695981039346656037u;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211u;
  hash ^= hash >> 33;  // the last characters must reach the high bits
  hash *= 0xff51afd7ed558ccdu;
  return hash ^ (hash >> 33);
}

}  // namespace

bool IsAudited(const UnitRef& unit, double share) {
  constexpr double kRange = 18446744073709551616.0;  // 2^64
  if (unit.key.kind == v1::UNIT_KIND_PLAN) return false;
  return share > 0 && static_cast<double>(HashOf(unit)) < share * kRange;
}

void Scheduler::StartAudit(const UnitIndex& index, const std::string& worker, absl::string_view digest,
                           absl::Time now) {
  Job& job = jobs_.at(index.job);
  if (digest.empty() || worker.empty()) {
    ++job.audits_waived;
    return;
  }
  Audit& audit = job.audits[index.place];
  audit.votes.push_back({worker, std::string(digest)});
  audit.deadline = now + options_.audit_patience;
  audit_deadlines_.emplace(audit.deadline, index);
  ++job.frames.at(index.place.frame).audits;
  UpdateCommitted(job, index.place.frame);
  ReturnAudit(index);
}

std::optional<Place> Scheduler::TakeAudit(Job& job, WorkerId worker) {
  const std::string& name = workers_.Find(worker)->traits.name;
  int looked = 0;
  for (auto it = job.audits_ready.begin(); it != job.audits_ready.end() && looked < kMaxAuditsLooked;
       ++it, ++looked) {
    Audit& audit = job.audits.at(it->second);
    const bool has_voted = std::any_of(audit.votes.begin(), audit.votes.end(),
                                       [&](const Vote& vote) { return vote.worker == name; });
    if (has_voted || audit.declined.contains(name)) continue;
    const Place place = it->second;
    job.audits_ready.erase(it);
    audit.leased = true;
    return place;
  }
  return std::nullopt;
}

void Scheduler::ReturnAudit(const UnitIndex& index) {
  Job& job = jobs_.at(index.job);
  const auto audit = job.audits.find(index.place);
  if (audit == job.audits.end()) return;
  audit->second.leased = false;
  job.audits_ready.emplace(static_cast<int>(audit->second.votes.size()), index.place);
  UpdateReady(index.job, job);
}

void Scheduler::DeclineAudit(const UnitIndex& index, WorkerId worker) {
  const auto audit = jobs_.at(index.job).audits.find(index.place);
  audit->second.declined.insert(workers_.Find(worker)->traits.name);
  workers_.Change(worker, [](Worker& state) { ++state.units_failed; });
  ReturnAudit(index);
}

void Scheduler::CompleteAudit(Attempt attempt, absl::string_view digest, absl::Time now) {
  const Lease lease = RemoveLease(attempt);
  ReleaseSlot(lease.worker);
  Audit& audit = jobs_.at(lease.unit.job).audits.at(lease.unit.place);
  audit.leased = false;
  audit.votes.push_back({workers_.Find(lease.worker)->traits.name, std::string(digest)});
  DecideAudit(lease.unit, now);
}

void Scheduler::DecideAudit(const UnitIndex& index, absl::Time now) {
  Job& job = jobs_.at(index.job);
  const std::vector<Vote> votes = job.audits.at(index.place).votes;
  const auto agree = [&](const Vote& vote) {
    return std::count_if(votes.begin(), votes.end(),
                         [&](const Vote& other) { return other.digest == vote.digest; }) >= 2;
  };
  const auto right = std::find_if(votes.begin(), votes.end(), agree);
  if (right != votes.end()) {
    for (const Vote& vote : votes) {
      if (vote.digest == right->digest) continue;
      Convict(vote.worker, absl::StrCat("it delivered other pixels than two other workers for ",
                                        job::Describe(RefOf(index))));
    }
    ++job.audits_settled;
    EndAudit(index);
  } else if (votes.size() >= kMaxVotes) {
    ++job.audits_waived;
    EndAudit(index);
  } else {
    Audit& audit = job.audits.at(index.place);
    audit.deadline = now + options_.audit_patience;
    audit_deadlines_.emplace(audit.deadline, index);
    ReturnAudit(index);
  }
}

void Scheduler::Convict(const std::string& worker, const std::string& reason) {
  const bool was_blocked = blocked_.contains(worker);
  BlockWorker(worker, reason);
  FaultyWorker faulty{.name = worker, .reason = reason, .units = {}};
  const uint32_t number = deliverers_.Find(worker);
  for (auto& [job_number, job] : jobs_) {
    for (auto& [frame_index, frame] : job.frames) {
      for (size_t i = 0; number != 0 && i < frame.deliverers.size(); ++i) {
        if (frame.deliverers[i] != number) continue;
        const UnitIndex index{job_number, {frame_index, static_cast<int64_t>(i)}};
        frame.revoking.insert(index.place.number);
        if (!accepted_.contains(index))
          faulty.units.push_back(RefOf(index));  // otherwise UnitCommitted does it
      }
      UpdateCommitted(job, frame_index);
    }
  }
  if (!was_blocked || !faulty.units.empty()) newly_faulty_.push_back(std::move(faulty));
}

bool Scheduler::HasAuditor(const Job& job, const Audit& audit) const {
  std::set<std::string> asked = audit.declined;
  for (const Vote& vote : audit.votes) asked.insert(vote.worker);
  int available = workers_.Count(RequirementOf(job)).available;
  for (const std::string& name : asked) {
    for (const WorkerId id : workers_.Named(name)) {
      const Worker& worker = *workers_.Find(id);
      if (worker.IsAvailable() && RequirementOf(job).Admits(workers_.KindOf(worker.kind))) --available;
    }
  }
  return available > 0;
}

void Scheduler::ExpireAudits(absl::Time now) {
  while (!audit_deadlines_.empty() && audit_deadlines_.begin()->first <= now) {
    const auto [deadline, index] = *audit_deadlines_.begin();
    audit_deadlines_.erase(audit_deadlines_.begin());
    const auto job = jobs_.find(index.job);
    if (job == jobs_.end()) continue;
    const auto audit = job->second.audits.find(index.place);
    if (audit == job->second.audits.end() || audit->second.deadline != deadline) continue;
    if (audit->second.leased || HasAuditor(job->second, audit->second)) {
      audit->second.deadline = now + options_.audit_patience;
      audit_deadlines_.emplace(audit->second.deadline, index);
    } else {
      ++job->second.audits_waived;
      EndAudit(index);
    }
  }
}

void Scheduler::EndAudit(const UnitIndex& index) {
  Job& job = jobs_.at(index.job);
  const auto audit = job.audits.find(index.place);
  if (audit == job.audits.end()) return;
  job.audits_ready.erase({static_cast<int>(audit->second.votes.size()), index.place});
  job.audits.erase(audit);
  --job.frames.at(index.place.frame).audits;
  UpdateReady(index.job, job);
  if (UpdateCommitted(job, index.place.frame))
    newly_settled_.emplace_back(job.id, job.frame_list.NumberOf(index.place.frame));
}

void Scheduler::ReleaseDeliverers(const Frame& frame) {
  for (const uint32_t number : frame.deliverers) deliverers_.Release(number);
}

bool Scheduler::UpdateCommitted(Job& job, int frame) {
  const Frame& state = job.frames.at(frame);
  if (IsFrameComplete(job, state) && state.audits == 0 && state.revoking.empty()) {
    job.committed_frames.insert(frame);
    return true;
  }
  job.committed_frames.erase(frame);
  return false;
}

std::vector<FaultyWorker> Scheduler::TakeFaulty() { return std::exchange(newly_faulty_, {}); }

std::vector<std::pair<job::JobId, int32_t>> Scheduler::TakeSettledFrames() {
  return std::exchange(newly_settled_, {});
}

}  // namespace lumifold::scheduler
