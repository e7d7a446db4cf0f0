#include "server/coordinator/frame_queue.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lumifold::server {
namespace {

using job::JobId;
using testing::ElementsAre;
using testing::Pair;

const absl::Time kQueueStart = absl::FromUnixSeconds(1000);
constexpr absl::Duration kFirstPause = absl::Seconds(5);
constexpr uint64_t kBytesOfFrame = 100;

class FrameQueueTest : public testing::Test {
 protected:
  void Make(FinishOptions options) {
    options.pause = kFirstPause;
    queue_.emplace(options);
  }

  void AddJob(const std::string& id, const std::string& user, int priority = 0) {
    v1::Scheduling scheduling;
    scheduling.set_user(user);
    scheduling.set_priority(priority);
    queue_->AddJob(JobId(id), scheduling);
  }
  static DueFrame Frame(const std::string& id, int32_t number, int round = DueFrame::kResult) {
    return {.job = JobId(id), .number = number, .round = round, .memory_bytes = kBytesOfFrame};
  }
  void Push(const std::string& id, int32_t first, int32_t last) {
    for (int32_t number = first; number <= last; ++number) queue_->Push(Frame(id, number));
  }
  /// Begins all frames that may; their jobs and threads.
  std::vector<std::pair<std::string, int>> BeginAll(absl::Time now = kQueueStart) {
    std::vector<std::pair<std::string, int>> begun;
    while (const std::optional<RunningFrame> frame = queue_->Begin(now))
      begun.emplace_back(frame->due.job.value(), frame->threads);
    return begun;
  }
  /// Ends the frame of a job that has been running longest.
  void EndOne(const std::string& id, absl::Time now) {
    for (const RunningFrame& frame : queue_->running()) {
      if (frame.due.job.value() == id) return queue_->End(FramePart(frame.part()), now);
    }
    FAIL() << "no frame of " << id << " is running";
  }

  std::optional<FrameQueue> queue_;
};

TEST_F(FrameQueueTest, FramesOfAJobGoInTheirOrderEachOnce) {
  Make({.processes = 9});
  AddJob("j-1", "ann");
  EXPECT_FALSE(queue_->TakeNews());
  Push("j-1", 2, 2);
  Push("j-1", 1, 1);
  Push("j-1", 2, 2);
  queue_->Push(Frame("j-1", 2, 0));  // the estimate of a round is another thing than the result
  EXPECT_TRUE(queue_->TakeNews());
  EXPECT_FALSE(queue_->TakeNews());
  EXPECT_EQ(queue_->Begin(kQueueStart)->due.number, 2);
  EXPECT_EQ(queue_->Begin(kQueueStart)->due.number, 1);
  EXPECT_FALSE(queue_->Begin(kQueueStart).has_value()) << "frame 2 is running";
  queue_->End({{JobId("j-1"), 2}}, kQueueStart);
  EXPECT_TRUE(queue_->TakeNews());
  EXPECT_EQ(queue_->Begin(kQueueStart)->due.round, 0);
}

TEST_F(FrameQueueTest, PausesGrowWithFailuresUntilTheThird) {
  Make({.processes = 9});
  AddJob("j-1", "ann");
  DueFrame frame = Frame("j-1", 1);
  const auto begin = [&](absl::Time now) {
    frame = queue_->Begin(now)->due;
    queue_->End({frame.key()}, now);
  };
  ASSERT_TRUE(queue_->Retry(&frame, kQueueStart));
  EXPECT_EQ(queue_->NextDue(kQueueStart), kQueueStart + kFirstPause);
  EXPECT_FALSE(queue_->Begin(kQueueStart + kFirstPause - absl::Milliseconds(1)).has_value());
  begin(kQueueStart + kFirstPause);
  ASSERT_TRUE(queue_->Retry(&frame, kQueueStart));
  EXPECT_EQ(queue_->NextDue(kQueueStart), kQueueStart + 4 * kFirstPause);
  begin(kQueueStart + 4 * kFirstPause);
  EXPECT_FALSE(queue_->Retry(&frame, kQueueStart));
  EXPECT_EQ(queue_->NextDue(kQueueStart), absl::InfiniteFuture());
}

TEST_F(FrameQueueTest, WaitsForTheStorageAsOftenAsItMust) {
  Make({});
  AddJob("j-1", "ann");
  DueFrame frame = Frame("j-1", 1);
  const auto wait = [&] {
    queue_->AwaitStorage(&frame, kQueueStart);
    const absl::Duration pause = queue_->NextDue(kQueueStart) - kQueueStart;
    frame = queue_->Begin(absl::InfiniteFuture())->due;
    queue_->End({frame.key()}, kQueueStart);
    return pause;
  };
  std::vector<absl::Duration> pauses;
  for (int i = 0; i < 4; ++i) pauses.push_back(wait());
  EXPECT_THAT(pauses, ElementsAre(kFirstPause, 4 * kFirstPause, absl::Minutes(1), absl::Minutes(1)));
  for (int i = 0; i < 100; ++i) wait();
  EXPECT_EQ(frame.failures, 0) << "it is no failure of the frame";
  ASSERT_TRUE(queue_->Retry(&frame, kQueueStart));
  EXPECT_EQ(queue_->NextDue(kQueueStart), kQueueStart + kFirstPause);
}

TEST_F(FrameQueueTest, KnowsOfEachRunningFrameWhetherItIsStale) {
  Make({.processes = 2});
  AddJob("j-1", "ann");
  const FrameKey first(JobId("j-1"), 1);
  const FrameKey second(JobId("j-1"), 2);
  Push("j-1", 1, 2);
  queue_->MarkStale(first);
  BeginAll();
  EXPECT_FALSE(queue_->IsStale(first)) << "of the time before";
  EXPECT_TRUE(queue_->IsFinishing(JobId("j-1")));
  EXPECT_FALSE(queue_->IsFinishing(JobId("j-2")));
  queue_->MarkStale(first);
  EXPECT_TRUE(queue_->IsStale(first));
  EXPECT_FALSE(queue_->IsStale(second));
  queue_->End({second}, kQueueStart);
  EXPECT_TRUE(queue_->IsFinishing(JobId("j-1")));
  queue_->End({first}, kQueueStart);
  EXPECT_FALSE(queue_->IsFinishing(JobId("j-1")));
  Push("j-1", 1, 1);
  BeginAll();
  EXPECT_FALSE(queue_->IsStale(first)) << "it is finished again";
}

TEST_F(FrameQueueTest, KnowsHowMuchOfAJobsFramesIsFiltered) {
  Make({.processes = 3});
  AddJob("j-1", "ann");
  AddJob("j-2", "ann");
  Push("j-1", 1, 2);
  Push("j-2", 1, 1);
  BeginAll();
  const FramePart first = {{JobId("j-1"), 1}};
  EXPECT_EQ(queue_->CountsOf(JobId("j-1")).filtered, 0);
  EXPECT_TRUE(queue_->SetFiltered(first, 0.5));
  EXPECT_FALSE(queue_->SetFiltered(first, 0.5)) << "nothing has changed";
  EXPECT_TRUE(queue_->SetFiltered({{JobId("j-1"), 2}}, 7)) << "more than all is all";
  EXPECT_EQ(queue_->CountsOf(JobId("j-1")).filtered, 1.5);
  EXPECT_EQ(queue_->CountsOf(JobId("j-2")).filtered, 0);
  EXPECT_TRUE(queue_->SetFiltered(first, std::numeric_limits<double>::quiet_NaN())) << "a worker's word";
  EXPECT_EQ(queue_->CountsOf(JobId("j-1")).filtered, 1);
  queue_->End(first, kQueueStart);
  EXPECT_FALSE(queue_->SetFiltered(first, 0.75)) << "it is not running";
}

TEST_F(FrameQueueTest, AFrameAloneHasAllThreadsAndAQueueSharesThem) {
  Make({.processes = 0, .threads = 8, .memory_bytes = 100 * kBytesOfFrame});
  AddJob("j-1", "ann");
  Push("j-1", 1, 1);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 8)));
  Push("j-1", 2, 2);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 1))) << "another does not wait for it";
  EndOne("j-1", kQueueStart);
  EndOne("j-1", kQueueStart);
  Push("j-1", 3, 5);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 3), Pair("j-1", 3), Pair("j-1", 2)));
  for (int i = 0; i < 3; ++i) EndOne("j-1", kQueueStart);
  Push("j-1", 1, 100);
  EXPECT_THAT(BeginAll(), testing::AllOf(testing::SizeIs(8), testing::Each(Pair("j-1", 1))));
}

TEST_F(FrameQueueTest, TakesNoMoreMemoryThanThereIs) {
  Make({.processes = 0, .threads = 8, .memory_bytes = 2 * kBytesOfFrame + 10});
  AddJob("j-1", "ann");
  Push("j-1", 1, 9);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 4), Pair("j-1", 4)));
  DueFrame large = Frame("j-1", 10);
  large.memory_bytes = 9 * kBytesOfFrame;
  queue_->ForgetJob(JobId("j-1"));
  AddJob("j-1", "ann");
  queue_->Push(large);
  EndOne("j-1", kQueueStart);
  EXPECT_THAT(BeginAll(), testing::IsEmpty());
  EndOne("j-1", kQueueStart);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 8))) << "one frame runs whatever it takes";
}

TEST_F(FrameQueueTest, AProcessTakesNoMoreThanItsLimit) {
  Make({.processes = 0, .threads = 4, .memory_bytes = 100, .frame_memory_bytes = 50});
  AddJob("j-1", "ann");
  Push("j-1", 1, 9);
  EXPECT_THAT(BeginAll(), testing::SizeIs(2));
}

TEST_F(FrameQueueTest, AUserWhoHasNoneNeedNotWaitForLongOnesOfOthers) {
  Make({.processes = 0, .threads = 2, .memory_bytes = 100 * kBytesOfFrame});
  AddJob("j-1", "ann");
  AddJob("j-2", "bob");
  Push("j-1", 1, 9);
  EXPECT_THAT(BeginAll(), testing::SizeIs(2));
  Push("j-2", 1, 9);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-2", 1)));
  EndOne("j-1", kQueueStart + absl::Hours(1));
  EXPECT_THAT(BeginAll(kQueueStart + absl::Hours(1)), testing::IsEmpty()) << "there are two places";
  EndOne("j-1", kQueueStart + absl::Hours(1));
  EXPECT_THAT(BeginAll(kQueueStart + absl::Hours(1)), ElementsAre(Pair("j-2", 1))) << "he has had less";
}

TEST_F(FrameQueueTest, AFixedNumberOfProcessesIsKept) {
  Make({.processes = 2, .threads = 8});
  AddJob("j-1", "ann");
  AddJob("j-2", "bob");
  Push("j-1", 1, 9);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 4), Pair("j-1", 4)));
  Push("j-2", 1, 1);
  EXPECT_THAT(BeginAll(), testing::IsEmpty());
}

TEST_F(FrameQueueTest, FramesWithoutAPlaceHereGoToWorkersAndComeBackForThisCoordinator) {
  const job::WorkerId worker(7);
  Make({});
  AddJob("j-1", "ann");
  AddJob("j-2", "bob");
  Push("j-1", 1, 1);
  const auto away = [&](bool has_worker = true) {
    return queue_->BeginAway(kQueueStart, [&](const DueFrame&, const Claims&) {
      return has_worker ? std::optional(worker) : std::nullopt;
    });
  };
  EXPECT_FALSE(away().has_value()) << "it may not travel";
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 1)));
  for (const int32_t number : {2, 3}) {
    DueFrame frame = Frame("j-2", number);
    frame.may_travel = true;
    queue_->Push(frame);
  }
  Push("j-1", 2, 2);
  EXPECT_THAT(BeginAll(), testing::IsEmpty());
  EXPECT_FALSE(away(false).has_value());
  const std::optional<RunningFrame> sent = away();
  ASSERT_TRUE(sent.has_value()) << "the other job's frame, which stays here, is passed";
  EXPECT_EQ(sent->worker, worker);
  EXPECT_EQ(sent->due.number, 2);
  EXPECT_EQ(queue_->CountHere(), 1);
  EXPECT_TRUE(queue_->IsFinishing(JobId("j-2")));
  EndOne("j-1", kQueueStart);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 1))) << "what workers have takes no place here";
  queue_->ComeBack({{JobId("j-2"), 2}}, kQueueStart);
  EXPECT_FALSE(queue_->IsFinishing(JobId("j-2")));
  EXPECT_EQ(away()->due.number, 3);
  EXPECT_FALSE(away().has_value()) << "a worker had frame 2 already";
  EndOne("j-1", kQueueStart);
  EXPECT_EQ(queue_->Begin(kQueueStart)->due.number, 2);
  queue_->MarkStale({JobId("j-2"), 3});
  queue_->ComeBack({{JobId("j-2"), 3}}, kQueueStart);
  EXPECT_TRUE(queue_->waiting().empty()) << "it is rendered again first";
}

TEST_F(FrameQueueTest, WhatAWorkerDeliveredOfAnAuditedFrameIsMadeAgainByAnother) {
  Make({});
  AddJob("j-1", "ann");
  Push("j-1", 1, 1);
  DueFrame due = Frame("j-1", 2);
  due.may_travel = true;
  const FramePart part = {due.key()};
  queue_->Push(due);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 1)));
  const auto away = [&] {
    return queue_->BeginAway(kQueueStart, [](const DueFrame&, const Claims&) { return job::WorkerId(7); });
  };
  ASSERT_TRUE(away().has_value());
  queue_->Audit(part, {"ann", "one"}, kQueueStart);
  const std::optional<RunningFrame> audit = away();
  ASSERT_TRUE(audit.has_value());
  EXPECT_THAT(audit->due.claims, ElementsAre(testing::Field(&ClaimedResult::worker, "ann")));
  queue_->Audit(part, {"ben", "two"}, kQueueStart);
  EXPECT_FALSE(away().has_value()) << "this coordinator decides";
  queue_->MarkStale(due.key());
  EndOne("j-1", kQueueStart);
  const std::optional<RunningFrame> here = queue_->Begin(kQueueStart);
  ASSERT_TRUE(here.has_value());
  EXPECT_THAT(here->due.claims, testing::IsEmpty()) << "of units that were taken back";
  queue_->MarkStale(due.key());
  queue_->Audit(part, {"ann", "one"}, kQueueStart);
  EXPECT_TRUE(queue_->waiting().empty()) << "it is rendered again first";
}

class BlocksTest : public FrameQueueTest {
 protected:
  BlocksTest() {
    Make({});
    AddJob("j-1", "ann");
    DueFrame frame = Frame("j-1", 1);
    frame.block_count = 3;
    queue_->Push(frame);
  }
  void Offer(bool has_workers) {
    queue_->OfferBlocks([=](const DueFrame&) { return has_workers; });
  }
  /// The block that a worker gets; -1: none.
  int Away() {
    const auto begun =
        queue_->BeginAway(kQueueStart, [](const DueFrame&, const Claims&) { return job::WorkerId(7); });
    return begun.has_value() ? begun->block : -1;
  }
  static FramePart Block(int number) { return {kFrame, number}; }

  static inline const FrameKey kFrame{JobId("j-1"), 1};
};

TEST_F(BlocksTest, GoToWorkersSideBySideAndTheFrameWaitsForThem) {
  Offer(true);
  EXPECT_EQ(Away(), 0);
  EXPECT_EQ(Away(), 1);
  EXPECT_EQ(Away(), 2);
  EXPECT_EQ(Away(), -1);
  EXPECT_EQ(queue_->CountsOf(JobId("j-1")).running, 1);
  EXPECT_EQ(queue_->CountsOf(JobId("j-1")).waiting, 0);
  for (const int block : {1, 0}) {
    queue_->End(Block(block), kQueueStart, /*block_seconds=*/2);
    Offer(true);
    EXPECT_FALSE(queue_->Begin(kQueueStart).has_value());
  }
  EXPECT_TRUE(queue_->SetFiltered(Block(2), 0.5));
  EXPECT_NEAR(queue_->CountsOf(JobId("j-1")).filtered, 2.5 / 3, 1e-12);
  queue_->End(Block(2), kQueueStart);
  Offer(true);
  EXPECT_EQ(Away(), -1);
  const std::optional<RunningFrame> whole = queue_->Begin(kQueueStart);
  ASSERT_TRUE(whole.has_value());
  EXPECT_EQ(whole->block, FramePart::kWhole);
  EXPECT_THAT(whole->due.blocks.done, ElementsAre(1, 0, 2));
  EXPECT_EQ(whole->due.blocks.seconds, 4);
  EXPECT_TRUE(queue_->waiting().empty());
}

TEST_F(BlocksTest, WithoutWorkersTheFrameIsFinishedHere) {
  Offer(false);
  EXPECT_EQ(Away(), -1);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 1)));
}

TEST_F(BlocksTest, WhatAWorkerDoesNotDeliverGoesToAnother) {
  Offer(true);
  ASSERT_EQ(Away(), 0);
  queue_->ComeBack(Block(0), kQueueStart);
  EXPECT_EQ(Away(), 0);
  EXPECT_EQ(Away(), 1);
}

TEST_F(BlocksTest, WhenTheWorkersAreGoneTheRestIsMadeHere) {
  Offer(true);
  ASSERT_EQ(Away(), 0);
  ASSERT_EQ(Away(), 1);
  queue_->End(Block(0), kQueueStart);
  queue_->ComeBack(Block(1), kQueueStart);
  Offer(false);
  const std::optional<RunningFrame> whole = queue_->Begin(kQueueStart);
  ASSERT_TRUE(whole.has_value());
  EXPECT_THAT(whole->due.blocks.done, ElementsAre(0));
}

TEST_F(BlocksTest, WorkersThatFailAgainAndAgainGetNoMore) {
  Offer(true);
  for (int i = 0; i < 4; ++i) {
    ASSERT_EQ(Away(), 0);
    queue_->ComeBack(Block(0), kQueueStart);
    Offer(true);
  }
  EXPECT_EQ(Away(), -1);
  EXPECT_THAT(BeginAll(), ElementsAre(Pair("j-1", 1)));
}

TEST_F(BlocksTest, OfUnitsThatWereTakenBackAreOfNoUse) {
  Offer(true);
  ASSERT_EQ(Away(), 0);
  queue_->MarkStale(kFrame);
  EXPECT_EQ(Away(), -1);
  DueFrame again = Frame("j-1", 1);
  again.block_count = 3;
  queue_->Push(again);
  Offer(true);
  ASSERT_EQ(Away(), 0);
  queue_->End(Block(0), kQueueStart);  // the one of the time before
  ASSERT_EQ(queue_->running().size(), 1u);
  EXPECT_TRUE(queue_->waiting().front().blocks.done.empty());
}

TEST_F(BlocksTest, ThisCoordinatorTakesSomeToo) {
  Offer(true);
  EXPECT_EQ(queue_->Begin(kQueueStart)->block, 0);
  EXPECT_EQ(Away(), 1);
  queue_->End(Block(0), kQueueStart, /*block_seconds=*/1);
  EXPECT_EQ(queue_->Begin(kQueueStart)->block, 2);
  queue_->End(Block(2), kQueueStart, /*block_seconds=*/1);
  EXPECT_FALSE(queue_->Begin(kQueueStart).has_value()) << "a worker has the last one";
  queue_->End(Block(1), kQueueStart, /*block_seconds=*/1);
  EXPECT_THAT(queue_->Begin(kQueueStart)->due.blocks.done, ElementsAre(0, 2, 1));
}

TEST_F(BlocksTest, OfAnAuditAreComparedByAnotherWorker) {
  Offer(true);
  ASSERT_EQ(Away(), 0);
  queue_->Audit(Block(0), {"ann", "a"}, kQueueStart);
  EXPECT_EQ(Away(), 1) << "those that nobody has made come first";
  EXPECT_EQ(Away(), 2);
  std::vector<std::string> claimed;
  const auto begun = queue_->BeginAway(kQueueStart, [&](const DueFrame&, const Claims& claims) {
    for (const ClaimedResult& claim : claims) claimed.push_back(claim.worker);
    return job::WorkerId(8);
  });
  ASSERT_TRUE(begun.has_value());
  EXPECT_EQ(begun->block, 0);
  EXPECT_THAT(claimed, ElementsAre("ann"));
  ASSERT_EQ(begun->due.claims.size(), 1u);
  EXPECT_EQ(begun->due.claims[0].sha256, "a");
}

TEST_F(BlocksTest, WhereTwoDifferThisCoordinatorMakesTheBlock) {
  Offer(true);
  ASSERT_EQ(Away(), 0);
  queue_->Audit(Block(0), {"ann", "a"}, kQueueStart);
  for (const int other : {1, 2}) {
    ASSERT_EQ(Away(), other);
    queue_->End(Block(other), kQueueStart);
  }
  ASSERT_EQ(Away(), 0);
  queue_->Audit(Block(0), {"ben", "b"}, kQueueStart);
  EXPECT_EQ(Away(), -1);
  Offer(false);  // also when the workers have gone
  const std::optional<RunningFrame> here = queue_->Begin(kQueueStart);
  ASSERT_TRUE(here.has_value());
  EXPECT_EQ(here->block, 0);
  EXPECT_EQ(here->due.claims.size(), 2u);
  queue_->End(Block(0), kQueueStart);
  EXPECT_THAT(queue_->Begin(kQueueStart)->due.blocks.done, ElementsAre(1, 2, 0));
}

class EstimatesTest : public FrameQueueTest {
 protected:
  EstimatesTest() {
    Make({});
    AddJob("j-1", "ann");
    DueFrame frame = Frame("j-1", 1, 2);
    frame.may_travel = true;
    queue_->Push(frame);
    const auto away =
        queue_->BeginAway(kQueueStart, [](const DueFrame&, const Claims&) { return job::WorkerId(7); });
    part_ = away->part();
  }
  std::optional<RunningFrame> Away() {
    return queue_->BeginAway(kQueueStart, [](const DueFrame&, const Claims&) { return job::WorkerId(7); });
  }

  FramePart part_;
};

TEST_F(EstimatesTest, AreMadeHereOfWhatAWorkerHasFiltered) {
  EXPECT_EQ(part_.round, 2);
  EXPECT_FALSE(queue_->Begin(kQueueStart).has_value());
  queue_->End(part_, kQueueStart, /*block_seconds=*/3);
  EXPECT_FALSE(Away().has_value());
  const std::optional<RunningFrame> here = queue_->Begin(kQueueStart);
  ASSERT_TRUE(here.has_value());
  EXPECT_EQ(here->due.round, 2);
  EXPECT_EQ(here->due.blocks.seconds, 3);
  EXPECT_EQ(here->due.blocks.done.size(), 1u);
  queue_->End(here->part(), kQueueStart);
  EXPECT_TRUE(queue_->waiting().empty());
}

TEST_F(EstimatesTest, AWorkerThatFailsIsNotAskedAgain) {
  queue_->ComeBack(part_, kQueueStart);
  EXPECT_FALSE(Away().has_value());
  EXPECT_TRUE(queue_->Begin(kQueueStart)->due.blocks.done.empty());
}

TEST_F(EstimatesTest, OfUnitsThatWereTakenBackAreOfNoUse) {
  queue_->MarkStale(part_.frame);
  queue_->End(part_, kQueueStart, 3);
  EXPECT_TRUE(queue_->waiting().empty());
  queue_->Push(Frame("j-1", 1, 2));
  ASSERT_TRUE(queue_->Begin(kQueueStart).has_value());
}

TEST_F(EstimatesTest, OfAJobThatHasBegunAgainAreOfNoUse) {
  queue_->ForgetJob(JobId("j-1"));
  AddJob("j-1", "ann");
  queue_->End(part_, kQueueStart, 3);
  EXPECT_TRUE(queue_->waiting().empty());
}

/// Time that each job has had once the filter has worked for a while on one place.
std::map<std::string, double> Shares(FrameQueue* queue, const std::map<std::string, absl::Duration>& lengths,
                                     absl::Duration total) {
  std::map<std::string, double> had;
  std::map<std::string, int32_t> next;
  absl::Time now = kQueueStart;
  while (now < kQueueStart + total) {
    for (const auto& [id, length] : lengths) queue->Push({.job = JobId(id), .number = next[id]++ % 100});
    const std::optional<RunningFrame> frame = queue->Begin(now);
    const std::string id = frame->due.job.value();
    now += lengths.at(id);
    had[id] += absl::FDivDuration(lengths.at(id), total);
    queue->End({frame->due.key()}, now);
  }
  return had;
}

TEST_F(FrameQueueTest, UsersShareTimeNotFrames) {
  Make({});
  AddJob("j-1", "ann");
  AddJob("j-2", "bob");
  AddJob("j-3", "bob");
  const std::map<std::string, double> had =
      Shares(&*queue_, {{"j-1", absl::Seconds(60)}, {"j-2", absl::Seconds(2)}, {"j-3", absl::Seconds(2)}},
             absl::Hours(4));
  EXPECT_NEAR(had.at("j-1"), .5, .03);
  EXPECT_NEAR(had.at("j-2"), .5, .03);
  EXPECT_FALSE(had.contains("j-3")) << "it waits for the first of its user";
}

TEST_F(FrameQueueTest, PrioritiesWeighTheShares) {
  Make({});
  AddJob("j-1", "ann");
  AddJob("j-2", "bob");
  queue_->SetPriority(JobId("j-2"), 10);
  queue_->SetPriority(JobId("j-9"), 10);  // no such job
  const std::map<std::string, double> had =
      Shares(&*queue_, {{"j-1", absl::Seconds(4)}, {"j-2", absl::Seconds(4)}}, absl::Hours(4));
  EXPECT_NEAR(had.at("j-2"), 2.0 / 3, .03);
}

TEST_F(FrameQueueTest, TheEndOfAFrameOfAJobThatBeganAgainIsNotItsOwn) {
  Make({});
  AddJob("j-1", "ann");
  Push("j-1", 1, 2);
  BeginAll();
  queue_->ForgetJob(JobId("j-1"));
  EXPECT_TRUE(queue_->waiting().empty());
  queue_->ForgetJob(JobId("j-1"));  // no effect
  AddJob("j-1", "ann");
  Push("j-1", 1, 2);
  EXPECT_THAT(BeginAll(), testing::IsEmpty());
  EndOne("j-1", kQueueStart + absl::Seconds(1));
  EXPECT_THAT(BeginAll(), testing::SizeIs(1));
}

}  // namespace
}  // namespace lumifold::server
