#include "proto/threads/event.h"

#include <gtest/gtest.h>

#include <thread>

namespace lumifold::threads {
namespace {

TEST(Event, EndsAWait) {
  Event event;
  EXPECT_FALSE(event.HasBeenNotified());
  EXPECT_FALSE(event.WaitFor(absl::Milliseconds(1)));
  std::thread other([&] { event.Notify(); });
  EXPECT_TRUE(event.WaitFor(absl::InfiniteDuration()));
  EXPECT_TRUE(event.HasBeenNotified());
  other.join();
}

TEST(Event, NotificationsBeforeItIsConsumedAreOne) {
  Event event;
  event.Notify();
  event.Notify();
  EXPECT_TRUE(event.WaitFor(absl::ZeroDuration()));
  EXPECT_TRUE(event.Consume(absl::ZeroDuration()));
  EXPECT_FALSE(event.Consume(absl::Milliseconds(1)));
}

TEST(Event, ANotificationOfAnotherThreadIsNotLostBetweenTwoWaits) {
  Event event;
  std::thread other([&] { event.Notify(); });
  EXPECT_TRUE(event.Consume(absl::InfiniteDuration()));
  other.join();
  event.Notify();
  EXPECT_TRUE(event.Consume(absl::InfiniteDuration()));
}

}  // namespace
}  // namespace lumifold::threads
