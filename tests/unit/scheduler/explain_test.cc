// Each reason why a job does not run, with its names and numbers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::JobId;
using job::WorkerId;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

class ExplainTest : public SchedulerFixture {
 protected:
  std::vector<std::string> Explain(const JobId& job, absl::Duration after = {}) {
    std::vector<std::string> lines;
    for (const Reason& reason : scheduler_.Explain(job, kStart + after))
      lines.push_back(absl::StrCat(reason.code, ": ", reason.text));
    return lines;
  }
  void AddWorker(WorkerId id, const std::string& name, int slots, const std::string& numeric_class = "avx2") {
    scheduler_.workers().Add(id, {.name = name, .numeric_class = numeric_class, .slots = slots});
  }
};

TEST_F(ExplainTest, NoWorkerOfTheKind) {
  AddWorker(kAnn, "ann", 1, "sse2");
  scheduler_.jobs().Add(kJob, Spec(), {.tags = {"gpu", "night"}, .numeric_class = "avx2"});
  EXPECT_THAT(Explain(kJob), ElementsAre("no_worker: the job needs workers of class avx2 with the tags gpu, "
                                         "night, and none of the 1 connected workers is"));
  scheduler_.jobs().Add(kOther, Spec(), {.tags = {"gpu"}});
  EXPECT_THAT(Explain(kOther).at(0),
              "no_worker: the job needs workers of any class with the tags gpu, and none "
              "of the 1 connected workers is");
}

TEST_F(ExplainTest, WorkersThatAreNotAvailable) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int i = 1; i <= 6; ++i) AddWorker(WorkerId(i), absl::StrCat("w", i), 1);
  for (int i = 1; i <= 5; ++i) scheduler_.workers().Rest(WorkerId(i), "until 19:00");
  EXPECT_THAT(Explain(kJob), IsEmpty()) << "one is left";
  scheduler_.workers().Drain(WorkerId(6));
  EXPECT_THAT(
      Explain(kJob),
      ElementsAre("worker_unavailable: all 6 connected workers of any class are blocked, draining, resting, "
                  "set aside (0) or silent: w1 until 19:00, w2 until 19:00, w3 until 19:00, w4 until "
                  "19:00"));
}

TEST_F(ExplainTest, JobsOfTheSameUserThatComeFirst) {
  AddWorker(kAnn, "ann", 1);
  for (const char* id : {"j-0", "j-9"}) scheduler_.jobs().Add(JobId(id), Spec(), {.user = "ben"});
  scheduler_.jobs().Add(kJob, Spec(), {.user = "ben"});
  scheduler_.jobs().Add(kOther, Spec(), {.priority = 10, .user = "ben"});
  EXPECT_THAT(Explain(JobId("j-9")),
              ElementsAre("turn: 1 job of its user with the same priority comes first, the next is j-0"));
  EXPECT_THAT(Explain(kJob),
              ElementsAre("turn: 2 jobs of its user with the same priority come first, the next is j-0"));
  EXPECT_THAT(Explain(kOther), IsEmpty()) << "another priority";
}

TEST_F(ExplainTest, BusySlotsAndWhoHasThem) {
  AddWorker(kAnn, "ann", 7);
  for (int i = 1; i <= 5; ++i) {
    const std::string user = i == 1 ? "" : absl::StrCat("user", i);
    scheduler_.jobs().Add(JobId(absl::StrCat("j-", i)), Spec(), {.user = user, .max_leases = i == 5 ? 3 : 1});
  }
  GrantReceived();
  scheduler_.jobs().Add(JobId("j-6"), Spec(), {.user = "user6"});
  EXPECT_THAT(
      Explain(JobId("j-6")),
      ElementsAre("slots_busy: all 7 slots of the 1 workers that may render the job are busy: it has 0 "
                  "leases, user user5 has 3, user anonymous has 1, user user2 has 1, user user3 has 1; "
                  "the share of its user is 100 %"));
}

TEST_F(ExplainTest, ItsOwnLimitAndThatOfFrames) {
  scheduler_.frames().SetMaxActive(1);
  AddWorker(kAnn, "ann", 100);
  scheduler_.jobs().Add(kJob, Spec(), {.max_leases = 2});
  GrantReceived();
  EXPECT_THAT(Explain(kJob),
              ElementsAre("max_leases: the job has 2 leases, which is its own limit (max_leases 2)"));
  scheduler_.jobs().Add(kOther, Spec());
  EXPECT_THAT(Explain(kOther),
              ElementsAre("frames_in_flight: the next frame waits until one of the 1 frames in "
                          "flight is finished; their limit is 1"));
}

TEST_F(ExplainTest, FailuresThatWaitAndFailuresThatAreTriedAgain) {
  AddWorker(kAnn, "ann", 2);
  scheduler_.jobs().Add(kJob, Spec());
  const std::vector<GrantedLease> leases = GrantReceived();
  for (size_t i = 0; i < 2; ++i) {
    scheduler_.units().Fail(kAnn, leases[i].unit, leases[i].attempt, {.error = "no disk"},
                            kStart + static_cast<int>(i) * absl::Milliseconds(1500));
  }
  EXPECT_THAT(Explain(kJob, absl::Milliseconds(300)),
              ElementsAre("backoff: 2 units wait after failures; the longest is " +
                          job::Describe(leases[1].unit) + ", for 3 s"));
  scheduler_.ExpireLeases(kStart + absl::Milliseconds(2500));
  EXPECT_THAT(
      Explain(kJob, absl::Seconds(3)),
      ElementsAre("failures: j-1 frame 10 tile 0 geometry has failed 1 time, the last time on worker ann "
                  "(no disk), and is tried again"));
}

TEST_F(ExplainTest, LossesAndTheQuarantineThatFollows) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, "ann", 1);
  GrantReceived();
  scheduler_.workers().Remove(kAnn);
  AddWorker(WorkerId(9), "zoe", 1);
  EXPECT_THAT(Explain(kJob),
              ElementsAre("losses: 1 worker was lost with j-1 frame 10 tile 0 geometry, the first of "
                          "ann; it is tried again"));
  for (const char* name : {"ben", "eve"}) {
    scheduler_.workers().Drain(WorkerId(9));
    AddWorker(kBen, name, 1);
    GrantReceived();
    scheduler_.workers().Remove(kBen);
  }
  EXPECT_THAT(Explain(kJob).back(),
              "quarantine: 1 units with which workers were lost wait for a worker of their "
              "own, the first is j-1 frame 10 tile 0 geometry");
}

TEST_F(ExplainTest, ADisputeAndWhatDecidesIt) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, "ann", 1);
  const GrantedLease lease = GrantReceived().at(0);
  scheduler_.units().Fail(kAnn, lease.unit, lease.attempt, {.permanent = true, .error = "no camera"}, kStart);
  EXPECT_THAT(
      Explain(kJob).back(),
      "second_opinion: worker ann cannot render j-1 frame 10 tile 0 geometry (no camera); the job waits for "
      "another worker, because this one has delivered nothing yet");
  AddWorker(kBen, "ben", 1);
  EXPECT_THAT(
      Explain(kJob).back(),
      "second_opinion: worker ann cannot render j-1 frame 10 tile 0 geometry (no camera); another worker is "
      "asked");
  const GrantedLease second = scheduler_.GrantLeases(kBen, kStart).at(0);
  ASSERT_EQ(second.unit, lease.unit);
  scheduler_.units().Fail(kBen, second.unit, second.attempt, {.permanent = true, .error = "none"}, kStart);
  EXPECT_THAT(
      Explain(kJob, absl::Seconds(18)).back(),
      "second_opinion: workers ann, ben cannot render j-1 frame 10 tile 0 geometry (none); the job fails in "
      "42 s unless another worker connects");
}

TEST_F(ExplainTest, AUnitThatStandsStillAndOneThatIsOverdue) {
  scheduler_.jobs().Add(kJob, RowSpec(9));
  AddWorker(kAnn, "ann", 18);
  std::vector<GrantedLease> leases = GrantReceived();
  const std::string slow = job::Describe(leases[0].unit);
  const auto heartbeat = [&](absl::Duration after, int64_t progress) {
    std::vector<HeldLease> held;
    for (const GrantedLease& lease : leases)
      held.push_back({.unit = lease.unit, .attempt = lease.attempt, .progress = progress});
    scheduler_.workers().Heartbeat(kAnn, held, job::Attempt(0), kStart + after);
  };
  heartbeat(absl::Seconds(5), 1);
  AddWorker(kBen, "ben", 1);
  EXPECT_THAT(Explain(kJob, absl::Seconds(34)), IsEmpty());
  EXPECT_THAT(Explain(kJob, absl::Seconds(35)),
              ElementsAre("no_progress: " + slow +
                          " has been leased to worker ann for 35 s, and has "
                          "made no progress for 30 s; the next worker that is idle gets it too"));
  ASSERT_EQ(leases.size(), 18u);
  for (; leases.size() > 1; leases.pop_back()) {
    EXPECT_EQ(scheduler_.units().Complete(kAnn, leases.back().unit, leases.back().attempt,
                                          kStart + absl::Seconds(10)),
              Completion::kAccepted);
  }
  for (int seconds = 10; seconds <= 45; seconds += 5) {
    heartbeat(absl::Seconds(seconds), seconds);
    scheduler_.ExpireLeases(kStart + absl::Seconds(seconds));
  }
  EXPECT_THAT(Explain(kJob, absl::Seconds(45)),
              ElementsAre("overdue: " + slow +
                          " has been leased to worker ann for 45 s; the mean of "
                          "the job is 10 s"));
}

TEST_F(ExplainTest, ARenderedFrameIsFiltered) {
  scheduler_.jobs().Add(kJob, RowSpec(1, /*frames=*/2));
  AddWorker(kAnn, "ann", 100);
  for (const GrantedLease& lease : GrantReceived()) Commit(kAnn, lease);
  EXPECT_THAT(Explain(kJob), ElementsAre("filtering: 2 rendered frames are being filtered or wait for it"));
  scheduler_.frames().Finish(kJob, 0);
  EXPECT_THAT(Explain(kJob), ElementsAre("filtering: 1 rendered frames are being filtered or wait for it"));
}

}  // namespace
}  // namespace lumifold::scheduler
