#include "tests/unit/server/server_process.h"

#include <gtest/gtest.h>
#include <signal.h>

#include "tests/unit/server/farm_fixture.h"

namespace lumifold::server {
namespace {

class ServerProcessTest : public FarmFixture {
 protected:
  void StartProcess() {
    StopServer();
    process_ = std::make_unique<ServerProcess>(Options().data.folder, folder_.PathOf("log"));
    ASSERT_GT(process_->port(), 0);
    process_port_ = process_->port();
  }

  std::unique_ptr<ServerProcess> process_;
};

TEST_F(ServerProcessTest, KilledAgainAndAgainItLosesNothingItAcknowledged) {
  const std::string expected = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "killed");
  int64_t acknowledged = 0;
  for (int round = 0; round < 3; ++round) {
    StartProcess();
    EXPECT_GE(Get(job)->units_done(), acknowledged);
    const auto worker = Worker({.slots = 3, .vanish_after = 6, .spoil = [](v1::WorkerMessage& message) {
                                  // So slowly that some are acknowledged meanwhile.
                                  if (message.has_chunk()) absl::SleepFor(absl::Milliseconds(10));
                                }});
    worker->Wait();
    acknowledged += worker->acknowledged();  // other units may not be committed yet
    EXPECT_EQ(process_->End(SIGKILL), -SIGKILL);
  }
  StartProcess();
  EXPECT_GT(acknowledged, 0);
  EXPECT_GE(Get(job)->units_done(), acknowledged);
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(*Download(job, 0), expected);
  EXPECT_EQ(process_->End(SIGTERM), 0);
}

}  // namespace
}  // namespace lumifold::server
