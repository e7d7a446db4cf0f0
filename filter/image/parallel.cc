#include "filter/image/parallel.h"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include "filter/image/check.h"

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace lumifold {
namespace {

/// Tells ThreadSanitizer the ordering that it cannot see in a TBB built without it: the code before the loop
/// happens before the tasks, and the tasks happen before the code after the loop. Does nothing in other
/// builds.
class LoopOrder {
 public:
#ifdef __SANITIZE_THREAD__
  LoopOrder() { __tsan_release(&begin_); }
  ~LoopOrder() { __tsan_acquire(&end_); }
  void BeginTask() { __tsan_acquire(&begin_); }
  void EndTask() { __tsan_release(&end_); }

 private:
  char begin_ = 0;
  char end_ = 0;
#else
  void BeginTask() {}
  void EndTask() {}
#endif
};

/// The limit of threads of all pools together. TBB's own limit is the number of cores, or what its first user
/// requested.
constexpr size_t kMostThreads = 512;

class TbbPool final : public TaskPool {
 public:
  explicit TbbPool(int threads) : arena_(threads) {}

  void Run(int64_t count, absl::FunctionRef<void(int64_t)> task) override {
    if (count <= 0) return;
    LoopOrder order;
    arena_.execute([&] {
      const tbb::blocked_range<int64_t> all(0, count, 1);
      tbb::parallel_for(
          all,
          [&](const tbb::blocked_range<int64_t>& part) {
            order.BeginTask();
            for (int64_t i = part.begin(); i != part.end(); ++i) task(i);
            order.EndTask();
          },
          tbb::simple_partitioner());
    });
  }

  int Width() const override { return arena_.max_concurrency(); }

 private:
  tbb::task_arena arena_;
};

}  // namespace

std::unique_ptr<TaskPool> MakeTaskPool(int threads) {
  LUMIFOLD_CHECK(threads >= 1);
  static const tbb::global_control allowance(tbb::global_control::max_allowed_parallelism, kMostThreads);
  return std::make_unique<TbbPool>(threads);
}

void ParallelFor(TaskPool* pool, int64_t count, absl::FunctionRef<void(int64_t)> task) {
  if (pool != nullptr) return pool->Run(count, task);
  for (int64_t i = 0; i < count; ++i) task(i);
}

}  // namespace lumifold
