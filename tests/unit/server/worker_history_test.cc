#include "server/coordinator/worker_history.h"

#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"

namespace lumifold::server {
namespace {

const job::JobId kHistoryJob("j-1");

TEST(WorkerHistory, JoinsUnitsOfAFrameAndCountsFailures) {
  WorkerHistory history;
  const absl::Time start = absl::FromUnixSeconds(1000);
  history.AddUnit("ann", kHistoryJob, 1, start, absl::Seconds(2));
  history.AddUnit("ben", kHistoryJob, 1, start, absl::Seconds(9));
  history.AddFailure("ann", kHistoryJob, 1, start + absl::Seconds(5));
  history.AddUnit("ann", kHistoryJob, 1, start + absl::Seconds(8), absl::Seconds(3));
  history.AddUnit("ann", kHistoryJob, 2, start + absl::Seconds(9), absl::Seconds(1));
  const std::deque<FrameOfWorker> frames = history.Of("ann");
  ASSERT_EQ(frames.size(), 2u);
  EXPECT_EQ(frames[0].frame, 1);
  EXPECT_EQ(frames[0].units, 2);
  EXPECT_EQ(frames[0].failed, 1);
  EXPECT_EQ(frames[0].rendering, absl::Seconds(5));
  EXPECT_EQ(frames[0].first, start);
  EXPECT_EQ(frames[0].last, start + absl::Seconds(8));
  EXPECT_TRUE(history.Of("cleo").empty());
}

TEST(WorkerHistory, IsBounded) {
  WorkerHistory history;
  for (int frame = 0; frame < 100; ++frame)
    history.AddUnit("ann", kHistoryJob, frame, absl::UnixEpoch(), absl::ZeroDuration());
  EXPECT_EQ(history.Of("ann").size(), WorkerHistory::kMaxFrames);
  EXPECT_EQ(history.Of("ann").back().frame, 99);
  for (size_t i = 0; i < WorkerHistory::kMaxWorkers; ++i) {
    if (i == 10) history.AddFailure("ann", kHistoryJob, 1, absl::UnixEpoch());
    history.AddFailure(absl::StrCat("w", i), kHistoryJob, 1, absl::UnixEpoch());
  }
  EXPECT_FALSE(history.Of("ann").empty());
  EXPECT_TRUE(history.Of("w0").empty()) << "it has done nothing for longest";
}

}  // namespace
}  // namespace lumifold::server
