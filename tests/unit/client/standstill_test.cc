#include "client/farm/standstill.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::client {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

TEST(StandstillTest, IsToldSecondsAfterTheLastChangeAndNotAllTheTime) {
  Standstill standstill;
  const absl::Time start = absl::FromUnixSeconds(1000);
  EXPECT_FALSE(standstill.IsTimeToAsk(start)) << "nothing is known of the job";
  v1::JobStatus job;
  job.set_state(v1::JOB_STATE_RUNNING);
  standstill.Note(job, start);
  EXPECT_FALSE(standstill.IsTimeToAsk(start + absl::Seconds(3)));
  job.set_samples_done(7);
  standstill.Note(job, start + absl::Seconds(3));
  EXPECT_FALSE(standstill.IsTimeToAsk(start + absl::Seconds(6)));
  standstill.Note(job, start + absl::Seconds(6));  // the same again
  EXPECT_TRUE(standstill.IsTimeToAsk(start + absl::Seconds(7)));
  EXPECT_FALSE(standstill.IsTimeToAsk(start + absl::Seconds(21)));
  EXPECT_TRUE(standstill.IsTimeToAsk(start + absl::Seconds(22)));
  job.set_state(v1::JOB_STATE_PAUSED);
  standstill.Note(job, start + absl::Seconds(30));
  EXPECT_FALSE(standstill.IsTimeToAsk(start + absl::Seconds(33)));
  EXPECT_TRUE(standstill.IsTimeToAsk(start + absl::Seconds(34)));
}

TEST(StandstillTest, EachKindOfReasonIsGivenOnce) {
  Standstill standstill;
  v1::ExplainJobResponse answer;
  const auto add = [&](const std::string& code, const std::string& text) {
    v1::Reason* const reason = answer.add_reasons();
    reason->set_code(code);
    reason->set_text(text);
  };
  add("no_worker", "none is connected");
  add("filtering", "2 frames are being filtered");
  EXPECT_THAT(standstill.NewReasons(answer), ElementsAre("none is connected"));
  EXPECT_THAT(standstill.NewReasons(answer), IsEmpty());
  add("turn", "1 job comes first");
  EXPECT_THAT(standstill.NewReasons(answer), ElementsAre("1 job comes first"));
}

}  // namespace
}  // namespace lumifold::client
