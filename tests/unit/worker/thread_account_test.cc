#include "worker/leases/thread_account.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <vector>

namespace lumifold::worker {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

TEST(ThreadAccount, AddsTheTimeOfAllThreadsByJob) {
  ThreadAccount account;
  std::vector<std::thread> threads;
  threads.reserve(4);
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&account] {
      for (int n = 0; n < 1000; ++n) account.Add(n % 2 == 0 ? "even" : "odd", absl::Milliseconds(1 + n % 2));
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(account.CloseAll(), ElementsAre(Pair("even", absl::Seconds(2)), Pair("odd", absl::Seconds(4))));
}

TEST(ThreadAccount, ReportsATimeOnce) {
  ThreadAccount account;
  account.Add("a", absl::Seconds(3));
  EXPECT_EQ(account.Close("a"), absl::Seconds(3));
  EXPECT_EQ(account.Close("a"), absl::ZeroDuration());
  account.Add("a", absl::Seconds(1));  // a thread was still at work for the job when it ended
  EXPECT_THAT(account.CloseAll(), ElementsAre(Pair("a", absl::Seconds(1))));
  EXPECT_THAT(account.CloseAll(), IsEmpty());
}

}  // namespace
}  // namespace lumifold::worker
