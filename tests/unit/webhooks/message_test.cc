#include "server/webhooks/message.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::webhooks {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(WebhookMessage, IsSignedAsOtherProgramsDoIt) {
  // hmac.new(b"0123456789abcdef0123456789abcdef", b'1700000000.{"job_id":"j-1"}', hashlib.sha256)
  EXPECT_EQ(SignatureOf("0123456789abcdef0123456789abcdef", 1'700'000'000, R"({"job_id":"j-1"})"),
            "sha256=21f2eacf9ceaa3c304ed14f9953fd7b9b3ebb15bc2c8ccaae99d7d06c4b32f56");
}

TEST(WebhookMessage, SaysHowTheJobHasEnded) {
  v1::JobStatus job;
  job.set_job_id("j-1");
  job.set_display_name("chair \"17\"\n");
  job.set_state(v1::JOB_STATE_DONE);
  job.set_first_frame(7);
  job.set_frames_done(2);
  job.set_frames_total(2);
  const std::string done = MessageOf(job, "d1", absl::FromUnixMillis(1'700'000'000'123));
  EXPECT_THAT(done, HasSubstr(R"("delivery_id":"d1","job_id":"j-1","name":"chair \"17\"\n")"));
  EXPECT_THAT(done, HasSubstr(R"("state":"JOB_STATE_DONE","error":"")"));
  EXPECT_THAT(done, HasSubstr(R"("ended_unix_ms":"1700000000123")"));
  EXPECT_THAT(done, HasSubstr(R"("result":"/api/result?job=j-1&frame=7")"));
  EXPECT_THAT(done, HasSubstr(R"("results":"/api/results?job=j-1")"));
  job.set_state(v1::JOB_STATE_FAILED);
  job.set_error("broken");
  job.set_frames_done(0);
  const std::string failed = MessageOf(job, "d2", absl::UnixEpoch());
  EXPECT_THAT(failed, HasSubstr(R"("state":"JOB_STATE_FAILED","error":"broken")"));
  EXPECT_THAT(failed, Not(HasSubstr("/api/")));
}

}  // namespace
}  // namespace lumifold::webhooks
