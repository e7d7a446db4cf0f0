#include <gtest/gtest.h>

#include <string>

#include "tests/unit/server/farm_fixture.h"

namespace lumifold::server {
namespace {

using LeavingTest = FarmFixture;

/// A worker that takes one grant and leaves without delivering a unit of it.
void TakeAndLeave(const std::shared_ptr<grpc::Channel>& channel, const std::string& name) {
  const auto stub = v1::WorkerService::NewStub(channel);
  grpc::ClientContext context;
  const auto stream = stub->Work(&context);
  v1::WorkerMessage message;
  message.mutable_hello()->set_name(name);
  message.mutable_hello()->set_numeric_class("test");
  message.mutable_hello()->set_slots(2);
  message.mutable_hello()->set_wire_version(rpc::kWireVersion);
  message.mutable_hello()->add_tags("night");
  stream->Write(message);
  v1::CoordinatorMessage answer;
  while (!answer.has_grant()) ASSERT_TRUE(stream->Read(&answer));
  message.mutable_leaving()->set_reason("signal");
  stream->Write(message);
  message.mutable_hand_back()->mutable_leases()->CopyFrom(answer.grant().leases());
  stream->Write(message);
  bool is_released = false;
  while (!is_released) {
    ASSERT_TRUE(stream->Read(&answer));
    EXPECT_FALSE(answer.has_grant());
    is_released = answer.has_released();
  }
  stream->WritesDone();
  EXPECT_FALSE(stream->Read(&answer));
  EXPECT_TRUE(stream->Finish().ok());
}

TEST_F(LeavingTest, UnitsThatAreHandedBackAreNotLost) {
  const std::string job = *Submit(Spec());
  // As losses, these would put the units into quarantine and then fail the job.
  for (int i = 0; i < 8; ++i) TakeAndLeave(Channel(), "node" + std::to_string(i));
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_PLANNED);
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(worker->delivered(), kUnits);
}

TEST_F(LeavingTest, AWorkerWithTagsThatAreTooLongIsRefused) {
  const auto worker = Worker({.spoil = [](v1::WorkerMessage& message) {
    if (message.has_hello()) message.mutable_hello()->add_tags(std::string(65, 't'));
  }});
  EXPECT_EQ(worker->Wait().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace lumifold::server
