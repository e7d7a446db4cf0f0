#include "server/coordinator/finish_delivery.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/unit/server/coordinator_fixture.h"

namespace lumifold::server {
namespace {

class FinishDeliveryTest : public CoordinatorFixture {
 protected:
  /// The codes of the calls with a lease of this job that nobody has.
  absl::StatusCode FetchUnits(const job::JobId& job) {
    return coordinator_->workers().OpenUnits(With<v1::FetchUnitsRequest>(job), "bob").status().code();
  }
  absl::StatusCode DeliverResult(const job::JobId& job) {
    return coordinator_->workers().ReceiveResult(With<v1::ResultAnnouncement>(job), "bob").status().code();
  }

 private:
  template <typename Message>
  static Message With(const job::JobId& job) {
    Message message;
    message.set_worker_id("w-1");
    message.mutable_unit()->set_job_id(job.value());
    message.mutable_unit()->set_kind(v1::UNIT_KIND_RESULT);
    message.set_attempt(1);
    return message;
  }
};

TEST_F(FinishDeliveryTest, NeedsALeaseOfAnActiveJob) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec());
  EXPECT_EQ(FetchUnits(job), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(DeliverResult(job), absl::StatusCode::kPermissionDenied);
  ASSERT_TRUE(Cancel(job).ok());
  EXPECT_EQ(FetchUnits(job), absl::StatusCode::kNotFound);
  EXPECT_EQ(DeliverResult(job), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace lumifold::server
