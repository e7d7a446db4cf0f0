// Units with which workers were lost again and again: they are rendered once more, alone on a worker.
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {

using job::WorkerId;

namespace {

/// Workers that are reserved at a time: a network that breaks again and again must not take the whole farm.
constexpr size_t kMaxReservations = 16;

/// Free workers that are looked at for one unit.
constexpr int kMaxCandidates = 16;

/// Names of lost workers in an error.
constexpr size_t kMaxNames = 4;

}  // namespace

std::string Scheduler::CountLoss(const Lease& lease) {
  if (lease.audit) return "";  // a worker has rendered the unit
  History& history = jobs_.at(lease.unit.job).history[lease.unit.place];
  history.lost_workers.insert(workers_.Find(lease.worker)->traits.name);
  if (!lease.alone || !lease.received) return "";
  const std::set<std::string> distinct(history.lost_workers.begin(), history.lost_workers.end());
  std::vector<std::string> names(distinct.begin(), distinct.end());
  if (names.size() > kMaxNames) names.resize(kMaxNames);
  return absl::StrCat(Describe(RefOf(lease.unit)), ": workers were lost with it ",
                      history.lost_workers.size(),
                      " times, the last one while it rendered nothing else: ", absl::StrJoin(names, ", "));
}

bool Scheduler::IsSuspect(const UnitIndex& index) const {
  const Job& job = jobs_.at(index.job);
  const auto history = job.history.find(index.place);
  if (history == job.history.end()) return false;
  const std::multiset<std::string>& lost = history->second.lost_workers;
  if (static_cast<int>(lost.size()) >= 2 * options_.max_lost_workers) return true;
  return static_cast<int>(std::set<std::string>(lost.begin(), lost.end()).size()) >=
         options_.max_lost_workers;
}

void Scheduler::NoteAbsence(const Lease& lease) {
  const uint64_t instance = workers_.Find(lease.worker)->traits.instance;
  if (instance != 0 && !lease.audit) lost_with_[instance].push_back(lease.unit);
}

void Scheduler::TakeBackLosses(WorkerId worker) {
  const WorkerTraits& traits = workers_.Find(worker)->traits;
  const auto lost_with = lost_with_.extract(traits.instance);
  if (lost_with.empty()) return;
  for (const UnitIndex& index : lost_with.mapped()) {
    const auto job = jobs_.find(index.job);
    if (job == jobs_.end()) continue;
    const auto history = job->second.history.find(index.place);
    if (history == job->second.history.end()) continue;  // it was accepted since
    std::multiset<std::string>& lost = history->second.lost_workers;
    if (const auto loss = lost.find(traits.name); loss != lost.end()) lost.erase(loss);
    if (quarantine_.contains(index) && !IsSuspect(index)) {
      quarantine_.erase(index);
      Return(index);
    }
  }
}

void Scheduler::GrantQuarantined(absl::Time now, std::vector<GrantedLease>* granted) {
  size_t looked_at = 0;
  for (auto it = quarantine_.begin();
       it != quarantine_.end() && reservations_.size() < kMaxReservations && looked_at < kMaxReservations;
       ++looked_at) {
    const bool paused = jobs_.at(it->job).paused;
    const std::optional<WorkerId> worker = paused ? std::nullopt : FindWorkerFor(*it);
    if (!worker.has_value()) {
      ++it;
      continue;
    }
    workers_.Change(*worker, [](Worker& state) { state.reserved = true; });
    reservations_.emplace(*worker, Reservation{*it});
    it = quarantine_.erase(it);
  }
  for (auto& [worker, reservation] : reservations_) {
    if (reservation.granted || workers_.Find(worker)->busy > 0) continue;
    reservation.granted = true;
    granted->push_back(Grant(reservation.unit, worker, now, LeaseKind::kAlone));
  }
}

std::optional<WorkerId> Scheduler::FindWorkerFor(const UnitIndex& index) const {
  const Requirement& requirement = RequirementOf(jobs_.at(index.job));
  std::optional<int> kind = workers_.NextFreeKind(-1);
  while (kind.has_value() && !requirement.Admits(workers_.KindOf(*kind))) kind = workers_.NextFreeKind(*kind);
  return kind.has_value() ? FindWorkerFor(index, *kind) : std::nullopt;
}

std::optional<WorkerId> Scheduler::FindWorkerFor(const UnitIndex& index, int kind) const {
  const std::multiset<std::string>& lost = jobs_.at(index.job).history.at(index.place).lost_workers;
  std::optional<WorkerId> best;
  int best_score = -1;
  std::optional<WorkerId> worker = workers_.NextFree(kind, WorkerId(-1));
  for (int i = 0; i < kMaxCandidates && worker.has_value(); ++i) {
    const Worker& state = *workers_.Find(*worker);
    const int score = (lost.contains(state.traits.name) ? 0 : 2) + (state.busy == 0 ? 1 : 0);
    if (score > best_score) {
      best = worker;
      best_score = score;
    }
    worker = workers_.NextFree(kind, *worker);
  }
  return best;
}

void Scheduler::CancelReservation(WorkerId worker) {
  const auto reservation = reservations_.find(worker);
  if (reservation == reservations_.end() || reservation->second.granted) return;
  quarantine_.insert(reservation->second.unit);
  reservations_.erase(reservation);
  workers_.Change(worker, [](Worker& state) { state.reserved = false; });
}

void Scheduler::RemoveFromQuarantine(const UnitIndex& index) {
  for (auto it = reservations_.begin(); it != reservations_.end(); ++it) {
    if (it->second.unit != index || it->second.granted) continue;
    CancelReservation(it->first);
    break;
  }
  quarantine_.erase(index);
}

}  // namespace lumifold::scheduler
