// Decisions of the scheduler per second, on a farm of 10,000 workers with two slots each and 200 jobs.
#include <benchmark/benchmark.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {
namespace {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

constexpr int kWorkers = 10'000;
constexpr int kSlots = 2;
constexpr int kJobs = 200;
constexpr absl::Duration kLease = absl::Seconds(30);

/// 2040 tiles, 5 units each, in 4 frames.
v1::JobSpec Spec() {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(1920);
  spec.set_height(1080);
  spec.set_tile_size(32);
  spec.set_samples_per_pixel(256);
  spec.set_pass_samples(64);
  spec.set_frame_count(4);
  return spec;
}

/// A farm whose slots are all leased.
class Farm {
 public:
  Farm() {
    for (int i = 0; i < kJobs; ++i) scheduler.jobs().Add(JobId("j-" + std::to_string(i)), Spec());
    for (int i = 0; i < kWorkers; ++i)
      scheduler.workers().Add(WorkerId(i), {.numeric_class = "avx2", .slots = kSlots});
    Grant();
  }

  /// As the coordinator does after every event.
  void Grant() {
    for (const GrantedLease& lease : scheduler.GrantLeases(now))
      held.push_back({lease.worker, lease.unit, lease.attempt});
  }

  struct Held {
    WorkerId worker;
    UnitRef unit;
    Attempt attempt;
  };

  /// Delivers and commits the lease at `index` of `held`, which a new lease then replaces.
  void Commit(size_t index) {
    const Held lease = held[index];
    held[index] = held.back();
    held.pop_back();
    if (scheduler.units().Complete(lease.worker, lease.unit, lease.attempt, now) != Completion::kAccepted)
      std::abort();
    scheduler.units().Commit(lease.unit);
    Grant();
    if (held.size() != size_t{kWorkers} * kSlots) std::abort();
  }

  void Heartbeat(size_t index) {
    const Held& lease = held[index];
    scheduler.workers().Heartbeat(lease.worker, {{lease.unit, lease.attempt}}, Attempt(0), now);
  }

  size_t Draw() {
    random_ = random_ * 6364136223846793005u + 1442695040888963407u;
    return (random_ >> 33) % held.size();
  }

  Scheduler scheduler{{.lease = kLease}};
  absl::Time now = absl::FromUnixSeconds(1'000'000);
  std::vector<Held> held;

 private:
  uint64_t random_ = 1;
};

void GrantWithNobodyFree(benchmark::State& state) {
  Farm farm;
  for (auto _ : state) farm.Grant();
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(GrantWithNobodyFree);

void Heartbeat(benchmark::State& state) {
  Farm farm;
  for (auto _ : state) farm.Heartbeat(farm.Draw());
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(Heartbeat);

void NextExpiry(benchmark::State& state) {
  Farm farm;
  for (auto _ : state) benchmark::DoNotOptimize(farm.scheduler.NextExpiry());
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(NextExpiry);

/// A worker leaves and another comes: its leases are granted again.
void WorkerLeaves(benchmark::State& state) {
  Farm farm;
  int64_t next = kWorkers;
  for (auto _ : state) {
    farm.scheduler.workers().Remove(WorkerId(next - kWorkers));
    farm.scheduler.workers().Add(WorkerId(next), {.numeric_class = "avx2", .slots = kSlots});
    benchmark::DoNotOptimize(farm.scheduler.GrantLeases(farm.now));
    ++next;
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(WorkerLeaves);

/// A unit is delivered and committed, and its slot gets the next one.
void CommitAndGrant(benchmark::State& state) {
  Farm farm;
  for (auto _ : state) farm.Commit(farm.Draw());
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(CommitAndGrant);

/// As a coordinator sees it: a commit, a heartbeat, and the check of the deadlines after each.
void Mixture(benchmark::State& state) {
  Farm farm;
  for (auto _ : state) {
    farm.Commit(farm.Draw());
    farm.Heartbeat(farm.Draw());
    farm.Grant();
    benchmark::DoNotOptimize(farm.scheduler.ExpireLeases(farm.now));
    benchmark::DoNotOptimize(farm.scheduler.NextExpiry());
  }
  state.SetItemsProcessed(state.iterations() * 5);
}
BENCHMARK(Mixture);

}  // namespace
}  // namespace lumifold::scheduler

BENCHMARK_MAIN();
