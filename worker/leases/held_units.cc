#include "worker/leases/held_units.h"

#include <algorithm>

#include "proto/rpc/monotonic.h"

namespace lumifold::worker {
namespace {

bool IsSameUnit(const v1::UnitId& a, const v1::UnitId& b) {
  return a.job_id() == b.job_id() && a.frame() == b.frame() && a.tile() == b.tile() && a.pass() == b.pass() &&
         a.kind() == b.kind();
}

/// Whether the leases are for the same samples of the same pixels, whatever their attempts.
bool IsSameWork(v1::Lease a, v1::Lease b) {
  for (v1::Lease* lease : {&a, &b}) {
    lease->clear_attempt();
    lease->clear_progress();
  }
  return a.SerializeAsString() == b.SerializeAsString();
}

}  // namespace

bool IsLease(const v1::Lease& lease, const v1::UnitId& unit, int64_t attempt) {
  return lease.attempt() == attempt && IsSameUnit(lease.unit(), unit);
}

void HeldUnits::Add(const v1::Lease& lease) {
  newest_attempt_ = std::max(newest_attempt_, lease.attempt());
  held_.push_back(lease);
  const TakenPtr in_hand = TakeInHand(lease);
  if (in_hand == nullptr) {
    waiting_.push_back(std::make_shared<TakenUnit>(lease));
    return;
  }
  in_hand->lease = lease;
  taken_[lease.attempt()] = in_hand;
  if (!in_hand->has_thread) waiting_.push_front(in_hand);  // it is rendered
}

TakenPtr HeldUnits::TakeInHand(const v1::Lease& lease) {
  const auto found = std::find_if(in_hand_.begin(), in_hand_.end(), [&](const TakenPtr& taken) {
    return IsSameUnit(taken->lease.unit(), lease.unit());
  });
  if (found == in_hand_.end()) return nullptr;
  TakenPtr taken = *found;
  in_hand_.erase(found);
  if (IsSameWork(taken->lease, lease)) return taken;
  Stop(taken);
  return nullptr;
}

TakenPtr HeldUnits::TakeWaiting() {
  TakenPtr taken = std::move(waiting_.front());
  waiting_.pop_front();
  taken->has_thread = true;
  taken_[taken->lease.attempt()] = taken;
  return taken;
}

bool HeldUnits::IsDelivered(const v1::Lease& lease) const {
  const auto taken = taken_.find(lease.attempt());
  return taken != taken_.end() && taken->second->is_delivered;
}

bool HeldUnits::IsCurrent(const v1::Lease& lease, const TakenPtr& taken) const {
  const auto found = taken_.find(lease.attempt());
  return found != taken_.end() && found->second == taken;
}

void HeldUnits::LoseConnection(bool keep, size_t most) {
  newest_attempt_ = 0;
  std::erase_if(taken_, [&](const auto& entry) {
    const TakenPtr& taken = entry.second;
    if (taken->spec == nullptr || !keep) return false;  // nothing is rendered, or nobody will ask for it
    taken->is_delivered = false;
    taken->was_in_hand = true;
    in_hand_.push_back(taken);
    return true;
  });
  RemoveHeld([](const v1::Lease&) { return true; });
  while (in_hand_.size() > most) {
    Stop(in_hand_.front());
    in_hand_.erase(in_hand_.begin());
  }
}

void HeldUnits::Stop(const TakenPtr& taken) {
  past_progress_ += taken->control.progress;
  taken->control.stop = true;
}

void HeldUnits::StopTaken(const v1::Lease& lease) {
  const auto taken = taken_.find(lease.attempt());
  if (taken == taken_.end()) return;
  Stop(taken->second);
  taken_.erase(taken);
}

void HeldUnits::NoteIdle() {
  if (held_.empty()) idle_since_ = rpc::MonotonicNow();
}

void HeldUnits::AddTo(v1::Heartbeat* heartbeat) const {
  int64_t all = past_progress_;
  for (const auto& [attempt, taken] : taken_) all += taken->control.progress;
  for (const TakenPtr& taken : in_hand_) all += taken->control.progress;
  for (const v1::Lease& lease : held_) {
    const auto own = taken_.find(lease.attempt());
    *heartbeat->add_held() = lease;
    heartbeat->mutable_held()->rbegin()->set_progress(
        own == taken_.end() ? all : own->second->control.progress.load());
  }
  heartbeat->set_newest_attempt(newest_attempt_);
}

void HeldUnits::AddTo(monitoring::WorkerFigures* figures) const {
  figures->units_in_hand = static_cast<int64_t>(in_hand_.size());
  figures->leases = {{"waiting", 0}, {"rendering", 0}, {"delivered", 0}};
  for (const v1::Lease& lease : held_) {
    const char* const state = !IsTaken(lease) ? "waiting" : IsDelivered(lease) ? "delivered" : "rendering";
    ++figures->leases[state];
  }
}

}  // namespace lumifold::worker
