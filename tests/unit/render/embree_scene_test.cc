#include "worker/render/embree_scene.h"

#include <gtest/gtest.h>

#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "filter/image/parallel.h"
#include "tests/support/analytic_scenes.h"

namespace lumifold::render {
namespace {

TEST(EmbreeScene, LeavesPoolsTheirThreads) {
  const scene::Scene room = testing::SmallRoom();
  const auto embree = EmbreeScene::Create(room);
  ASSERT_TRUE(embree.ok()) << embree.status();
  absl::Notification begun[2];
  bool met[2] = {false, false};
  MakeTaskPool(2)->Run(2, [&](int64_t i) {
    begun[i].Notify();
    met[i] = begun[1 - i].WaitForNotificationWithTimeout(absl::Seconds(20));
  });
  EXPECT_TRUE(met[0] && met[1]) << "the pool's two tasks did not run side by side";
}

}  // namespace
}  // namespace lumifold::render
