#include "server/scheduler/quarantine.h"

#include <cstddef>

namespace lumifold::scheduler {

using job::WorkerId;

namespace {

/// Workers that are reserved at a time: a network that breaks again and again must not take the whole farm.
constexpr size_t kMaxReservations = 16;

/// Free workers that are looked at for one unit.
constexpr int kMaxCandidates = 16;

}  // namespace

void Quarantine::AddLoss(const UnitIndex& unit, const std::string& party) { losses_[unit].insert(party); }

const Quarantine::Losses& Quarantine::LossesOf(const UnitIndex& unit) const {
  static const auto* const none = new Losses;
  const auto found = losses_.find(unit);
  return found == losses_.end() ? *none : found->second;
}

std::optional<UnitIndex> Quarantine::FirstLossOf(int64_t job) const {
  for (auto it = losses_.lower_bound({job, {}}); it != losses_.end() && it->first.job == job; ++it) {
    if (!it->second.empty()) return it->first;
  }
  return std::nullopt;
}

bool Quarantine::IsSuspect(const UnitIndex& unit) const {
  const Losses& losses = LossesOf(unit);
  if (static_cast<int>(losses.size()) >= 2 * max_lost_workers_) return true;
  int parties = 0;
  for (auto it = losses.begin(); it != losses.end(); it = losses.upper_bound(*it)) ++parties;
  return parties >= max_lost_workers_;
}

void Quarantine::NoteAbsence(uint64_t instance, const UnitIndex& unit) {
  if (instance != 0) lost_with_[instance].push_back(unit);
}

std::vector<UnitIndex> Quarantine::TakeBackLosses(uint64_t instance, const std::string& party) {
  const auto lost_with = lost_with_.extract(instance);
  if (lost_with.empty()) return {};
  for (const UnitIndex& unit : lost_with.mapped()) {
    const auto losses = losses_.find(unit);
    if (losses == losses_.end()) continue;  // it was accepted since
    if (const auto loss = losses->second.find(party); loss != losses->second.end())
      losses->second.erase(loss);
  }
  return lost_with.mapped();
}

bool Quarantine::Release(const UnitIndex& unit) { return !IsSuspect(unit) && waiting_.erase(unit) > 0; }

void Quarantine::Reserve(absl::FunctionRef<const Requirement*(const UnitIndex&)> requirement_of,
                         absl::FunctionRef<bool(const Worker&, const UnitIndex&)> may_render) {
  size_t looked_at = 0;
  for (auto it = waiting_.begin();
       it != waiting_.end() && reservations_.size() < kMaxReservations && looked_at < kMaxReservations;
       ++looked_at) {
    const Requirement* requirement = requirement_of(*it);
    const std::optional<WorkerId> worker =
        requirement == nullptr ? std::nullopt : FindWorkerFor(*it, *requirement, may_render);
    if (!worker.has_value()) {
      ++it;
      continue;
    }
    SetReserved(*worker, true);
    reservations_.emplace(*worker, Reservation{*it});
    it = waiting_.erase(it);
  }
}

std::optional<WorkerId> Quarantine::FindWorkerFor(
    const UnitIndex& unit, const Requirement& requirement,
    absl::FunctionRef<bool(const Worker&, const UnitIndex&)> may_render) const {
  const Losses& lost = LossesOf(unit);
  std::optional<WorkerId> best;
  int best_score = -1;
  int looked_at = 0;
  for (std::optional<int> kind = workers_->NextFreeKind(-1); kind.has_value();
       kind = workers_->NextFreeKind(*kind)) {
    if (!requirement.Admits(workers_->KindOf(*kind))) continue;
    std::optional<WorkerId> worker = workers_->NextFree(*kind, WorkerId(-1));
    for (; looked_at < kMaxCandidates && worker.has_value(); ++looked_at) {
      const Worker& state = *workers_->Find(*worker);
      const int score = (lost.contains(state.traits.party) ? 0 : 2) + (state.busy == 0 ? 1 : 0);
      if (score > best_score && may_render(state, unit)) {
        best = worker;
        best_score = score;
      }
      worker = workers_->NextFree(*kind, *worker);
    }
  }
  return best;
}

std::vector<std::pair<WorkerId, UnitIndex>> Quarantine::TakeReady() {
  std::vector<std::pair<WorkerId, UnitIndex>> ready;
  for (auto& [worker, reservation] : reservations_) {
    if (reservation.leased || workers_->Find(worker)->busy > 0) continue;
    reservation.leased = true;
    ready.emplace_back(worker, reservation.unit);
  }
  return ready;
}

void Quarantine::SetReserved(WorkerId worker, bool reserved) {
  workers_->Change(worker, [reserved](Worker& state) { state.reserved = reserved; });
}

void Quarantine::Cancel(WorkerId worker) {
  const auto reservation = reservations_.find(worker);
  if (reservation == reservations_.end() || reservation->second.leased) return;
  waiting_.insert(reservation->second.unit);
  reservations_.erase(reservation);
  SetReserved(worker, false);
}

void Quarantine::CancelOfJob(int64_t job) {
  std::vector<WorkerId> reserved;
  for (const auto& [worker, reservation] : reservations_) {
    if (reservation.unit.job == job) reserved.push_back(worker);
  }
  for (const WorkerId worker : reserved) Cancel(worker);
}

void Quarantine::EndIfIdle(WorkerId worker) {
  const auto reservation = reservations_.find(worker);
  if (reservation == reservations_.end() || !reservation->second.leased) return;
  if (workers_->Find(worker)->busy > 0) return;
  reservations_.erase(reservation);
  SetReserved(worker, false);
}

void Quarantine::Forget(const UnitIndex& unit) {
  if (losses_.erase(unit) == 0) return;
  for (const auto& [worker, reservation] : reservations_) {
    if (reservation.unit != unit || reservation.leased) continue;
    Cancel(worker);
    break;
  }
  waiting_.erase(unit);
}

void Quarantine::EndJob(int64_t job) {
  CancelOfJob(job);
  waiting_.erase(waiting_.lower_bound({job, {}}), waiting_.lower_bound({job + 1, {}}));
  losses_.erase(losses_.lower_bound({job, {}}), losses_.lower_bound({job + 1, {}}));
  for (auto& [instance, units] : lost_with_)
    std::erase_if(units, [job](const UnitIndex& unit) { return unit.job == job; });
  std::erase_if(lost_with_, [](const auto& entry) { return entry.second.empty(); });
}

}  // namespace lumifold::scheduler
