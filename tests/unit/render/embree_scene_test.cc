#include "worker/render/embree_scene.h"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <thread>

#include "absl/synchronization/notification.h"
#include "filter/image/parallel.h"

namespace lumifold::render {
namespace {

TEST(EmbreeScene, LeavesOtherPoolsOfTheProcessTheirThreads) {
  if (std::thread::hardware_concurrency() < 2) GTEST_SKIP() << "one core only";
  const auto embree = EmbreeScene::Create(scene::Scene{});
  ASSERT_TRUE(embree.ok()) << embree.status();
  // Each of two tasks waits for the other to begin: one thread alone would wait in vain.
  std::array<absl::Notification, 2> begun;
  std::atomic<int> met = 0;
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(2);
  pool->Run(2, [&](int64_t i) {
    begun[static_cast<size_t>(i)].Notify();
    if (begun[static_cast<size_t>(1 - i)].WaitForNotificationWithTimeout(absl::Seconds(30))) ++met;
  });
  EXPECT_EQ(met, 2);
}

}  // namespace
}  // namespace lumifold::render
