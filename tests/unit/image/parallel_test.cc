#include "filter/image/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

namespace lumifold {
namespace {

void ExpectEachTaskRunsOnce(TaskPool* pool) {
  std::vector<std::atomic<int>> calls(1000);
  ParallelFor(pool, 1000, [&](int64_t i) { calls[static_cast<size_t>(i)].fetch_add(1); });
  for (const std::atomic<int>& count : calls) EXPECT_EQ(count.load(), 1);
}

TEST(ParallelFor, RunsEachTaskOnceWithoutAPool) { ExpectEachTaskRunsOnce(nullptr); }

TEST(TaskPool, RunsEachTaskOnceForAnyWidth) {
  for (const int threads : {1, 2, 5}) {
    const auto pool = MakeTaskPool(threads);
    EXPECT_EQ(pool->Width(), threads);
    ExpectEachTaskRunsOnce(pool.get());
  }
}

TEST(TaskPool, NeverRunsMoreTasksAtATimeThanItsWidth) {
  const auto pool = MakeTaskPool(2);
  std::atomic<int> running{0};
  std::atomic<int> most{0};
  pool->Run(2000, [&](int64_t) {
    const int now = running.fetch_add(1) + 1;
    int seen = most.load();
    while (now > seen && !most.compare_exchange_weak(seen, now)) {
    }
    running.fetch_sub(1);
  });
  EXPECT_LE(most.load(), 2);
}

TEST(TaskPool, DoesNothingForNoTasks) {
  const auto pool = MakeTaskPool(2);
  pool->Run(0, [](int64_t) { FAIL(); });
}

TEST(TaskPool, RunsTasksThatUseItThemselves) {
  const auto pool = MakeTaskPool(2);
  std::atomic<int> calls{0};
  pool->Run(10, [&](int64_t) { pool->Run(10, [&](int64_t) { calls.fetch_add(1); }); });
  EXPECT_EQ(calls.load(), 100);
}

}  // namespace
}  // namespace lumifold
