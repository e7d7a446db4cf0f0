#include "filter/image/parallel.h"

#ifdef __SANITIZE_THREAD__
#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>
#else
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#endif

#include "filter/image/check.h"

namespace lumifold {
namespace {

#ifdef __SANITIZE_THREAD__

/// ThreadSanitizer does not see what orders threads inside a TBB built without it. Here threads are ordered
/// by their start and end alone, so that tasks of one loop that share memory without an order are found.
class ThreadsOfEachLoop final : public TaskPool {
 public:
  explicit ThreadsOfEachLoop(int threads) : threads_(threads) {}

  void Run(int64_t count, absl::FunctionRef<void(int64_t)> task) override {
    std::atomic<int64_t> next = 0;
    const auto run_tasks = [&] {
      for (int64_t i; (i = next.fetch_add(1, std::memory_order_relaxed)) < count;) task(i);
    };
    std::vector<std::thread> others;
    for (int64_t i = 1; i < std::min<int64_t>(threads_, count); ++i) others.emplace_back(run_tasks);
    run_tasks();
    for (std::thread& other : others) other.join();
  }

  int Width() const override { return threads_; }

 private:
  const int threads_;
};

std::unique_ptr<TaskPool> MakePool(int threads) { return std::make_unique<ThreadsOfEachLoop>(threads); }

#else

/// The limit of threads of all pools together. TBB's own limit is the number of cores, or what its first user
/// requested.
constexpr size_t kMostThreads = 512;

class TbbPool final : public TaskPool {
 public:
  explicit TbbPool(int threads) : arena_(threads) {}

  void Run(int64_t count, absl::FunctionRef<void(int64_t)> task) override {
    if (count <= 0) return;
    arena_.execute([&] {
      const tbb::blocked_range<int64_t> all(0, count, 1);
      tbb::parallel_for(
          all,
          [&](const tbb::blocked_range<int64_t>& part) {
            for (int64_t i = part.begin(); i != part.end(); ++i) task(i);
          },
          tbb::simple_partitioner());
    });
  }

  int Width() const override { return arena_.max_concurrency(); }

 private:
  tbb::task_arena arena_;
};

std::unique_ptr<TaskPool> MakePool(int threads) {
  static const tbb::global_control allowance(tbb::global_control::max_allowed_parallelism, kMostThreads);
  return std::make_unique<TbbPool>(threads);
}

#endif

}  // namespace

std::unique_ptr<TaskPool> MakeTaskPool(int threads) {
  LUMIFOLD_CHECK(threads >= 1);
  return MakePool(threads);
}

void ParallelFor(TaskPool* pool, int64_t count, absl::FunctionRef<void(int64_t)> task) {
  if (pool != nullptr) return pool->Run(count, task);
  for (int64_t i = 0; i < count; ++i) task(i);
}

}  // namespace lumifold
