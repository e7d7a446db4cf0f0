#include "worker/leases/held_units.h"

#include <algorithm>
#include <utility>

#include "proto/rpc/monotonic.h"

namespace lumifold::worker {
namespace {

bool IsSameUnit(const v1::UnitId& a, const v1::UnitId& b) {
  return a.job_id() == b.job_id() && a.frame() == b.frame() && a.tile() == b.tile() && a.pass() == b.pass() &&
         a.kind() == b.kind();
}

}  // namespace

bool IsLease(const v1::Lease& lease, const v1::UnitId& unit, int64_t attempt) {
  return lease.attempt() == attempt && IsSameUnit(lease.unit(), unit);
}

void HeldUnits::Add(const v1::Lease& lease) {
  newest_attempt_ = std::max(newest_attempt_, lease.attempt());
  held_.push_back(lease);
  waiting_.push_back(lease);
}

TakenPtr HeldUnits::TakeWaiting() {
  const auto taken = std::make_shared<TakenUnit>(std::move(waiting_.front()));
  waiting_.pop_front();
  taken_[taken->lease.attempt()] = taken;
  return taken;
}

bool HeldUnits::IsDelivered(const v1::Lease& lease) const {
  const auto taken = taken_.find(lease.attempt());
  return taken != taken_.end() && taken->second->is_delivered;
}

bool HeldUnits::IsHeld(const TakenPtr& taken) const {
  const auto found = taken_.find(taken->lease.attempt());
  return found != taken_.end() && found->second == taken;
}

void HeldUnits::LoseConnection() {
  newest_attempt_ = 0;
  kept_.Clear();
  RemoveHeld([](const v1::Lease&) { return true; });
}

void HeldUnits::StopTaken(const v1::Lease& lease) {
  const auto taken = taken_.find(lease.attempt());
  if (taken == taken_.end()) return;
  past_progress_ += taken->second->control.progress;
  taken->second->control.stop = true;
  taken_.erase(taken);
}

void HeldUnits::NoteIdle() {
  if (held_.empty()) idle_since_ = rpc::MonotonicNow();
}

void HeldUnits::AddTo(v1::Heartbeat* heartbeat) const {
  int64_t all = past_progress_;
  for (const auto& [attempt, taken] : taken_) all += taken->control.progress;
  for (const v1::Lease& lease : held_) {
    const auto own = taken_.find(lease.attempt());
    v1::Lease* const held = heartbeat->add_held();
    *held = lease;
    held->set_progress(own == taken_.end() ? all : own->second->control.progress.load());
    if (own != taken_.end()) held->set_filtered(own->second->control.filtered);
  }
  heartbeat->set_newest_attempt(newest_attempt_);
}

void HeldUnits::AddTo(monitoring::WorkerMetrics* metrics) const {
  metrics->leases = {{"waiting", 0}, {"rendering", 0}, {"delivered", 0}};
  for (const v1::Lease& lease : held_) {
    const char* const state = !IsTaken(lease) ? "waiting" : IsDelivered(lease) ? "delivered" : "rendering";
    ++metrics->leases[state];
  }
}

}  // namespace lumifold::worker
