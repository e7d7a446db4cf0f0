#include "server/scheduler/worker_pool.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "filter/image/check.h"

namespace lumifold::scheduler {
namespace {

constexpr uint64_t kAnyMemory = std::numeric_limits<uint64_t>::max();

/// The memory of a kind: its six leading bits.
uint64_t KindMemory(uint64_t bytes) {
  if (bytes == 0) return kAnyMemory;
  const int dropped = std::max(0, static_cast<int>(std::bit_width(bytes)) - 6);
  return bytes >> dropped << dropped;
}

}  // namespace

using job::WorkerId;

v1::WorkerState StateOf(const Worker& worker) {
  if (worker.blocked) return v1::WORKER_STATE_BLOCKED;
  if (worker.draining) return v1::WORKER_STATE_DRAINING;
  if (worker.IsCooling()) return v1::WORKER_STATE_SET_ASIDE;
  if (worker.unresponsive) return v1::WORKER_STATE_SILENT;
  if (!worker.rest.empty()) return v1::WORKER_STATE_RESTING;
  return worker.busy > 0 ? v1::WORKER_STATE_BUSY : v1::WORKER_STATE_IDLE;
}

Requirement Requirement::Of(const std::string& numeric_class, std::vector<std::string> tags) {
  std::sort(tags.begin(), tags.end());
  tags.erase(std::unique(tags.begin(), tags.end()), tags.end());
  return {numeric_class, std::move(tags)};
}

bool Requirement::Admits(const Requirement& kind) const {
  return memory_bytes <= kind.memory_bytes &&
         (numeric_class.empty() || numeric_class == kind.numeric_class) &&
         std::includes(kind.tags.begin(), kind.tags.end(), tags.begin(), tags.end());
}

void WorkerPool::Add(WorkerId id, const WorkerTraits& traits) {
  Worker worker;
  worker.traits = traits;
  worker.kind = AddKind(traits);
  const auto [it, is_new] = workers_.emplace(id, std::move(worker));
  LUMIFOLD_CHECK(is_new);
  Kind& kind = kinds_.at(it->second.kind);
  ++kind.workers;
  if (traits.slots > 0) ++kind.counts.connected;
  by_name_[traits.name].insert(id);
  Index(id, it->second);
  if (kind.counts.available == 1) ++version_;
}

int WorkerPool::AddKind(const WorkerTraits& traits) {
  Requirement kind = Requirement::Of(traits.numeric_class, traits.tags);
  kind.memory_bytes = KindMemory(traits.memory_bytes);
  const auto [it, is_new] = kind_numbers_.emplace(kind, next_kind_);
  if (is_new) kinds_[next_kind_++].kind = std::move(kind);
  return it->second;
}

void WorkerPool::Remove(WorkerId id) {
  const auto found = workers_.find(id);
  if (found == workers_.end()) return;
  const Worker& worker = found->second;
  Unindex(id, worker);
  ceased_.insert(id);
  const auto named = by_name_.find(worker.traits.name);
  named->second.erase(id);
  if (named->second.empty()) by_name_.erase(named);
  const auto kind = kinds_.find(worker.kind);
  if (kind->second.counts.available == 0) ++version_;
  if (worker.traits.slots > 0) --kind->second.counts.connected;
  if (--kind->second.workers == 0) {
    kind_numbers_.erase(kind->second.kind);
    kinds_.erase(kind);
  }
  workers_.erase(found);
}

void WorkerPool::Change(WorkerId id, absl::FunctionRef<void(Worker&)> change) {
  const auto found = workers_.find(id);
  if (found == workers_.end()) return;
  const int& available = kinds_.at(found->second.kind).counts.available;
  const bool before = available > 0;
  const bool was_available = found->second.IsAvailable();
  Unindex(id, found->second);
  change(found->second);
  Index(id, found->second);
  if (was_available && !found->second.IsAvailable()) ceased_.insert(id);
  if ((available > 0) != before) ++version_;
}

void WorkerPool::Unindex(WorkerId id, const Worker& worker) {
  KindCounts& counts = kinds_.at(worker.kind).counts;
  if (worker.IsCooling()) {
    cool_downs_.erase({worker.cools_until, id});
    --counts.cooling;
  }
  if (!worker.IsAvailable()) return;
  --counts.available;
  counts.slots -= worker.traits.slots;
  counts.busy -= worker.busy;
  if (!worker.IsFree()) return;
  const auto free = free_.find(worker.kind);
  free->second.erase(id);
  if (free->second.empty()) free_.erase(free);
}

void WorkerPool::Index(WorkerId id, const Worker& worker) {
  KindCounts& counts = kinds_.at(worker.kind).counts;
  if (worker.IsCooling()) {
    cool_downs_.emplace(worker.cools_until, id);
    ++counts.cooling;
  }
  if (!worker.IsAvailable()) return;
  ++counts.available;
  counts.slots += worker.traits.slots;
  counts.busy += worker.busy;
  if (worker.IsFree()) free_[worker.kind].insert(id);
}

const Worker* WorkerPool::Find(WorkerId id) const {
  const auto found = workers_.find(id);
  return found == workers_.end() ? nullptr : &found->second;
}

bool WorkerPool::IsFree(WorkerId id) const {
  const Worker* worker = Find(id);
  return worker != nullptr && worker->IsFree();
}

std::vector<WorkerId> WorkerPool::Named(const std::string& name) const {
  const auto found = by_name_.find(name);
  if (found == by_name_.end()) return {};
  return {found->second.begin(), found->second.end()};
}

std::vector<WorkerId> WorkerPool::After(WorkerId after, int limit) const {
  std::vector<WorkerId> ids;
  for (auto it = workers_.upper_bound(after); it != workers_.end() && static_cast<int>(ids.size()) < limit;
       ++it)
    ids.push_back(it->first);
  return ids;
}

KindCounts WorkerPool::Count(const Requirement& requirement) const {
  KindCounts sum;
  for (const auto& [number, kind] : kinds_) {
    if (!requirement.Admits(kind.kind)) continue;
    sum.connected += kind.counts.connected;
    sum.available += kind.counts.available;
    sum.cooling += kind.counts.cooling;
    sum.slots += kind.counts.slots;
    sum.busy += kind.counts.busy;
  }
  return sum;
}

uint64_t WorkerPool::LargestMemory(const Requirement& requirement) const {
  uint64_t most = 0;
  for (const auto& [number, kind] : kinds_) {
    const uint64_t bytes = kind.kind.memory_bytes;
    if (requirement.Admits(kind.kind) && kind.counts.connected > 0 && bytes != kAnyMemory)
      most = std::max(most, bytes);
  }
  return most;
}

bool WorkerPool::HasOther(WorkerId id, const Requirement& requirement) const {
  const Worker* self = Find(id);
  const bool counted = self != nullptr && self->IsAvailable() && requirement.Admits(KindOf(self->kind));
  return Count(requirement).available > (counted ? 1 : 0);
}

std::vector<WorkerId> WorkerPool::Cooled(absl::Time now) const {
  std::vector<WorkerId> workers;
  for (auto it = cool_downs_.begin(); it != cool_downs_.end() && it->first <= now; ++it)
    workers.push_back(it->second);
  return workers;
}

absl::Time WorkerPool::NextCooled() const {
  return cool_downs_.empty() ? absl::InfiniteFuture() : cool_downs_.begin()->first;
}

std::optional<int> WorkerPool::NextFreeKind(int kind) const {
  const auto next = free_.upper_bound(kind);
  return next == free_.end() ? std::nullopt : std::optional(next->first);
}

std::optional<WorkerId> WorkerPool::NextFree(int kind, WorkerId id) const {
  const auto free = free_.find(kind);
  if (free == free_.end()) return std::nullopt;
  const auto next = free->second.upper_bound(id);
  return next == free->second.end() ? std::nullopt : std::optional(*next);
}

}  // namespace lumifold::scheduler
