#include "server/scheduler/worker_pool.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace lumifold::scheduler {
namespace {

using job::WorkerId;

const std::vector<Requirement> kKinds = {Requirement::Of("avx2", {}), Requirement::Of("avx2", {"gpu"}),
                                         Requirement::Of("sse2", {"gpu", "big"})};
const std::vector<Requirement> kRequirements = {
    {}, Requirement::Of("avx2", {}), Requirement::Of("sse2", {}), Requirement::Of("", {"gpu"})};

absl::Time Second(int seconds) { return absl::FromUnixSeconds(seconds); }

/// What the pool says, from the workers one by one.
class Model {
 public:
  void Change(WorkerPool* pool, std::mt19937& random) {
    const WorkerId id(static_cast<int64_t>(random() % 5));
    const auto found = workers_.find(id);
    if (found == workers_.end()) return Add(pool, id, random);
    if (random() % 4 == 0) {
      workers_.erase(found);
      return pool->Remove(id);
    }
    const auto change = [what = random() % 6,
                         cools = Second(static_cast<int>(random() % 3))](Worker& worker) {
      if (what == 0) worker.unresponsive = !worker.unresponsive;
      if (what == 1) worker.draining = !worker.draining;
      if (what == 2) worker.blocked = !worker.blocked;
      if (what == 3) worker.cools_until = worker.IsCooling() ? absl::InfinitePast() : cools;
      if (what == 4) worker.busy = worker.busy < worker.traits.slots ? worker.busy + 1 : 0;
      if (what == 5) worker.reserved = !worker.reserved;
    };
    change(found->second);
    pool->Change(id, change);
  }

  void Compare(const WorkerPool& pool) const {
    for (const Requirement& requirement : kRequirements) {
      const KindCounts counts = pool.Count(requirement);
      const KindCounts wanted = Count(requirement);
      EXPECT_EQ(counts.connected, wanted.connected);
      EXPECT_EQ(counts.available, wanted.available);
      EXPECT_EQ(counts.cooling, wanted.cooling);
      EXPECT_EQ(counts.slots, wanted.slots);
      EXPECT_EQ(counts.busy, wanted.busy);
      for (const auto& [id, worker] : workers_) {
        const int self = worker.IsAvailable() && requirement.Admits(KindOf(worker)) ? 1 : 0;
        EXPECT_EQ(pool.HasOther(id, requirement), wanted.available > self);
      }
    }
    std::map<std::string, std::vector<WorkerId>> named;
    std::set<std::pair<absl::Time, WorkerId>> cooling;
    std::set<WorkerId> free;
    for (const auto& [id, worker] : workers_) {
      named[worker.traits.name].push_back(id);
      if (worker.IsCooling()) cooling.emplace(worker.cools_until, id);
      if (worker.IsFree()) free.insert(id);
      EXPECT_EQ(pool.IsFree(id), worker.IsFree());
    }
    for (const char* name : {"ann", "ben"}) EXPECT_EQ(pool.Named(name), named[name]);
    EXPECT_EQ(FreeOf(pool), free);
    EXPECT_EQ(pool.NextCooled(), cooling.empty() ? absl::InfiniteFuture() : cooling.begin()->first);
    std::vector<WorkerId> cooled;
    for (const auto& [until, id] : cooling) {
      if (until <= Second(1)) cooled.push_back(id);
    }
    EXPECT_EQ(pool.Cooled(Second(1)), cooled);
  }

  /// The kinds that have available workers.
  std::set<Requirement> Available() const {
    std::set<Requirement> kinds;
    for (const auto& [id, worker] : workers_) {
      if (worker.IsAvailable()) kinds.insert(KindOf(worker));
    }
    return kinds;
  }

 private:
  static Requirement KindOf(const Worker& worker) {
    return Requirement::Of(worker.traits.numeric_class, worker.traits.tags);
  }

  void Add(WorkerPool* pool, WorkerId id, std::mt19937& random) {
    const Requirement& kind = kKinds[random() % kKinds.size()];
    Worker worker;
    worker.traits.name = random() % 2 == 0 ? "ann" : "ben";
    worker.traits.numeric_class = kind.numeric_class;
    worker.traits.tags = kind.tags;
    worker.traits.slots = 1 + static_cast<int>(random() % 2);
    pool->Add(id, worker.traits);
    workers_.emplace(id, worker);
  }

  KindCounts Count(const Requirement& requirement) const {
    KindCounts counts;
    for (const auto& [id, worker] : workers_) {
      if (!requirement.Admits(KindOf(worker))) continue;
      ++counts.connected;
      counts.cooling += worker.IsCooling() ? 1 : 0;
      if (!worker.IsAvailable()) continue;
      ++counts.available;
      counts.slots += worker.traits.slots;
      counts.busy += worker.busy;
    }
    return counts;
  }

  static std::set<WorkerId> FreeOf(const WorkerPool& pool) {
    std::set<WorkerId> free;
    for (auto kind = pool.NextFreeKind(-1); kind.has_value(); kind = pool.NextFreeKind(*kind)) {
      for (auto id = pool.NextFree(*kind, WorkerId(-1)); id.has_value(); id = pool.NextFree(*kind, *id))
        free.insert(*id);
    }
    return free;
  }

  std::map<WorkerId, Worker> workers_;
};

TEST(WorkerPool, SaysWhatItsWorkersSayOneByOne) {
  std::mt19937 random(3);
  WorkerPool pool;
  Model model;
  for (int step = 0; step < 3000 && !::testing::Test::HasFailure(); ++step) {
    SCOPED_TRACE(step);
    const std::set<Requirement> before = model.Available();
    const int64_t version = pool.version();
    model.Change(&pool, random);
    model.Compare(pool);
    EXPECT_TRUE(model.Available() == before || pool.version() != version);
  }
}

}  // namespace
}  // namespace lumifold::scheduler
