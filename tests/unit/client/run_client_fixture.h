#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "client/commands/run_client.h"
#include "filter/image/exr_io.h"
#include "tests/unit/client/fake_farm.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {

/// Replaces the farm inside the process.
class FakeLocalFarm : public LocalFarm {
 public:
  explicit FakeLocalFarm(std::shared_ptr<grpc::Channel> channel) : channel_(std::move(channel)) {}
  std::shared_ptr<grpc::Channel> channel() override { return channel_; }

 private:
  std::shared_ptr<grpc::Channel> channel_;
};

/// Runs the client's commands against a fake farm, in a folder of their own.
class RunClientTest : public testing::Test {
 protected:
  static constexpr char kScene[] = R"({"asset":{"version":"2.0"},"buffers":[{"uri":"mesh.bin"}]})";

  RunClientTest() {
    scene_ = folder_.Write("room.gltf", kScene);
    folder_.Write("mesh.bin", std::string(2'500'000, 'm'));
    test_.environment.defaults.server = farm_.address();
    test_.environment.local.farm = [this](const LocalFarmOptions& options) {
      local_options_.push_back(options);
      return std::make_unique<FakeLocalFarm>(farm_.channel());
    };
    LayeredImage image(4, 3);
    image.AddColor("");
    image.AddColor("noisy");
    EXPECT_EQ(WriteExr(folder_.File("result"), image), absl::OkStatus());
    farm_.result = folder_.Read("result");
    farm_.jobs = {{"job-1", Job(v1::JOB_STATE_RUNNING)}};
    farm_.watched = {Job(v1::JOB_STATE_RUNNING), Job(v1::JOB_STATE_DONE)};
  }

  static v1::JobStatus Job(v1::JobState state) {
    v1::JobStatus job;
    job.set_job_id("job-1");
    job.set_state(state);
    return job;
  }

  int Run(const std::vector<std::string>& arguments) {
    std::vector<const char*> argv = {"lumifold"};
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    return RunClient(static_cast<int>(argv.size()), argv.data(), test_.environment);
  }

  std::string Out() const { return test_.out.str(); }
  std::string Err() const { return test_.err.str(); }

  FakeFarm farm_;
  ScratchFolder folder_;
  TestEnvironment test_;
  std::string scene_;
  std::vector<LocalFarmOptions> local_options_;
};

}  // namespace lumifold::client
