#include "filter/image/parallel.h"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include "filter/image/check.h"

namespace lumifold {
namespace {

/// Threads of all pools together. TBB by itself stops at the number of cores or at what its first user asked
/// for.
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
