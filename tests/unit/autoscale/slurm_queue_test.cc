#include "client/autoscale/slurm_queue.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"

namespace lumifold::autoscale {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using State = Request::State;

TEST(SlurmQueue, ReadsTheJobsOfTheFarmAndSkipsOthers) {
  const auto requests = ParseSlurmQueue(
      "12|RUNNING|2026-03-01T10:00:00|2026-03-01T14:00:00|8|None|lumifold-night-0\n"
      "13|PENDING|N/A|N/A|8|QOSMaxCpuPerUserLimit|lumifold-night-1\n"
      "14|RUNNING|2026-03-01T10:00:00|N/A|1|None|lumifold-day-0\n"
      "15|RUNNING|odd|odd|odd|odd|my | own | job\n"
      "16|RUNNING|2026-03-01T10:00:00|N/A|1|None|lumifold-night-x\n",
      "night");
  ASSERT_TRUE(requests.ok()) << requests.status();
  ASSERT_EQ(requests->size(), 2u);
  const Request& running = requests->at(0);
  EXPECT_EQ(running.id, "12");
  EXPECT_EQ(running.worker_name, "slurm-12");
  EXPECT_EQ(running.state, State::kRunning);
  EXPECT_EQ(running.slot, 0);
  EXPECT_EQ(running.cores, 8);
  EXPECT_EQ(absl::FormatTime(running.started, absl::UTCTimeZone()), "2026-03-01T10:00:00+00:00");
  const Request& pending = requests->at(1);
  EXPECT_EQ(pending.state, State::kPending);
  EXPECT_EQ(pending.detail, "QOSMaxCpuPerUserLimit");
  EXPECT_EQ(pending.started, absl::InfiniteFuture());
}

TEST(SlurmQueue, KnowsHowJobsEnd) {
  for (const auto& [state, end] : {std::pair("COMPLETED", Request::End::kLeft),
                                   {"FAILED", Request::End::kFailed},
                                   {"PREEMPTED", Request::End::kTaken},
                                   {"NODE_FAIL", Request::End::kTaken},
                                   {"CANCELLED", Request::End::kReleased},
                                   {"TIMEOUT", Request::End::kReleased}}) {
    const auto requests = ParseSlurmQueue(
        absl::StrCat("1|", state, "|2026-03-01T10:00:00|2026-03-01T10:00:05|1|None|lumifold-f-0"), "f");
    ASSERT_TRUE(requests.ok());
    EXPECT_EQ(requests->at(0).state, State::kEnded);
    EXPECT_EQ(requests->at(0).end, end) << state;
    EXPECT_EQ(requests->at(0).ended - requests->at(0).started, absl::Seconds(5));
  }
}

TEST(SlurmQueue, AStateOfALaterVersionCountsAsPending) {
  const auto requests = ParseSlurmQueue("1|POWERING_UP_NODE|N/A|N/A|1|None|lumifold-f-0", "f");
  ASSERT_TRUE(requests.ok());
  EXPECT_EQ(requests->at(0).state, State::kPending);
}

TEST(SlurmQueue, OfTwoJobsOfASlotTheYoungerThatWaitsIsADuplicate) {
  const auto requests = ParseSlurmQueue(
      "100|PENDING|N/A|N/A|1|Dependency|lumifold-f-0\n"
      "99|PENDING|N/A|N/A|1|Dependency|lumifold-f-0\n"
      "98|COMPLETED|2026-03-01T10:00:00|2026-03-01T10:00:05|1|None|lumifold-f-0\n"
      "97|PENDING|N/A|N/A|1|Dependency|lumifold-f-1\n"
      "96|COMPLETING|2026-03-01T10:00:00|N/A|1|None|lumifold-f-1\n",
      "f");
  ASSERT_TRUE(requests.ok());
  std::vector<bool> duplicates;
  for (const Request& request : *requests) duplicates.push_back(request.duplicate);
  EXPECT_THAT(duplicates, testing::ElementsAre(true, false, false, true, false));
}

TEST(SlurmQueue, RefusesWhatItDoesNotUnderstand) {
  for (const char* line : {"slurm_load_jobs error: Unable to contact slurm controller",
                           "1|RUNNING|then|N/A|1|None|lumifold-f-0", "x|RUNNING|N/A|N/A|1|None|lumifold-f-0",
                           "1|RUNNING|N/A|N/A|many|None|lumifold-f-0", "1|RUNNING|lumifold-f-0"}) {
    const auto requests = ParseSlurmQueue(line, "f");
    EXPECT_EQ(requests.status().code(), absl::StatusCode::kDataLoss) << line;
    EXPECT_THAT(std::string(requests.status().message()), HasSubstr(line));
  }
}

TEST(SlurmQueue, NamesSlotsAsItReadsThem) {
  EXPECT_EQ(SlurmJobName("a-1", 7), "lumifold-a-1-7");
  EXPECT_THAT(*ParseSlurmQueue("1|RUNNING|N/A|N/A|1|None|lumifold-a-1-7", "a"), IsEmpty());
  EXPECT_EQ(ParseSlurmQueue("1|RUNNING|N/A|N/A|1|None|lumifold-a-1-7", "a-1")->at(0).slot, 7);
}

}  // namespace
}  // namespace lumifold::autoscale
