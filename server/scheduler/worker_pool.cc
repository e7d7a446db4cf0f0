#include "server/scheduler/worker_pool.h"

#include <utility>

#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::WorkerId;

void WorkerPool::Add(WorkerId id, const std::string& name, const std::string& numeric_class, int slots) {
  LUMIFOLD_CHECK(slots >= 1);
  Worker worker;
  worker.name = name;
  worker.numeric_class = numeric_class;
  worker.slots = slots;
  const auto [it, is_new] = workers_.emplace(id, std::move(worker));
  LUMIFOLD_CHECK(is_new);
  Index(id, it->second);
}

void WorkerPool::Remove(WorkerId id) {
  const auto found = workers_.find(id);
  if (found == workers_.end()) return;
  Unindex(id, found->second);
  workers_.erase(found);
}

void WorkerPool::SetUnresponsive(WorkerId id, bool unresponsive) {
  const auto found = workers_.find(id);
  if (found == workers_.end() || found->second.unresponsive == unresponsive) return;
  Unindex(id, found->second);
  found->second.unresponsive = unresponsive;
  Index(id, found->second);
}

void WorkerPool::SetReserved(WorkerId id, bool reserved) {
  const auto found = workers_.find(id);
  if (found == workers_.end()) return;
  Unindex(id, found->second);
  found->second.reserved = reserved;
  Index(id, found->second);
}

void WorkerPool::SetAside(WorkerId id, absl::Time until) {
  const auto found = workers_.find(id);
  if (found == workers_.end()) return;
  Unindex(id, found->second);
  found->second.set_aside_until = until;
  Index(id, found->second);
}

void WorkerPool::AddBusy(WorkerId id, int change) {
  const auto found = workers_.find(id);
  if (found == workers_.end()) return;
  Unindex(id, found->second);
  found->second.busy += change;
  Index(id, found->second);
}

void WorkerPool::Unindex(WorkerId id, const Worker& worker) {
  if (worker.set_aside_until != absl::InfinitePast()) {
    readmissions_.erase({worker.set_aside_until, id});
    const auto aside = set_aside_.find(worker.numeric_class);
    if (--aside->second == 0) set_aside_.erase(aside);
  }
  if (!IsAvailable(worker)) return;
  const auto available = available_.find(worker.numeric_class);
  --all_available_;
  if (--available->second == 0) available_.erase(available);
  if (!IsFree(worker)) return;
  const auto free = free_.find(worker.numeric_class);
  free->second.erase(id);
  if (free->second.empty()) free_.erase(free);
}

void WorkerPool::Index(WorkerId id, const Worker& worker) {
  if (worker.set_aside_until != absl::InfinitePast()) {
    readmissions_.emplace(worker.set_aside_until, id);
    ++set_aside_[worker.numeric_class];
  }
  if (!IsAvailable(worker)) return;
  ++all_available_;
  ++available_[worker.numeric_class];
  if (IsFree(worker)) free_[worker.numeric_class].insert(id);
}

const Worker* WorkerPool::Find(WorkerId id) const {
  const auto found = workers_.find(id);
  return found == workers_.end() ? nullptr : &found->second;
}

bool WorkerPool::IsFree(WorkerId id) const {
  const Worker* worker = Find(id);
  return worker != nullptr && IsFree(*worker);
}

bool WorkerPool::HasOther(WorkerId id, const std::string& numeric_class) const {
  const auto available = available_.find(numeric_class);
  int others = available == available_.end() ? 0 : available->second;
  if (numeric_class.empty()) others = all_available_;
  const Worker* self = Find(id);
  const bool counted = self != nullptr && IsAvailable(*self) &&
                       (numeric_class.empty() || self->numeric_class == numeric_class);
  return others > (counted ? 1 : 0);
}

int WorkerPool::SetAsideCount(const std::string& numeric_class) const {
  const auto found = set_aside_.find(numeric_class);
  return found == set_aside_.end() ? 0 : found->second;
}

int WorkerPool::AvailableCount(const std::string& numeric_class) const {
  const auto found = available_.find(numeric_class);
  return found == available_.end() ? 0 : found->second;
}

std::vector<WorkerId> WorkerPool::Readmissible(absl::Time now) const {
  std::vector<WorkerId> workers;
  for (auto it = readmissions_.begin(); it != readmissions_.end() && it->first <= now; ++it)
    workers.push_back(it->second);
  return workers;
}

absl::Time WorkerPool::NextReadmission() const {
  return readmissions_.empty() ? absl::InfiniteFuture() : readmissions_.begin()->first;
}

std::optional<std::string> WorkerPool::NextFreeClass(const std::string& numeric_class) const {
  const auto next = free_.upper_bound(numeric_class);
  return next == free_.end() ? std::nullopt : std::optional(next->first);
}

std::optional<WorkerId> WorkerPool::NextFree(const std::string& numeric_class, WorkerId id) const {
  const auto free = free_.find(numeric_class);
  if (free == free_.end()) return std::nullopt;
  const auto next = free->second.upper_bound(id);
  return next == free->second.end() ? std::nullopt : std::optional(*next);
}

}  // namespace lumifold::scheduler
