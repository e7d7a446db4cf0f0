#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/farm/download.h"
#include "client/farm/follow_job.h"
#include "client/farm/upload.h"
#include "tests/unit/client/fake_farm.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

// Two coordinators; the client begins with the first.
class FailoverTest : public testing::Test {
 protected:
  FailoverTest() {
    for (int i = 0; i < 5500; ++i) first_.result += static_cast<char>(i * 7 + i / 256);
    second_.result = first_.result;
    farm_ = Connect(first_.address());
  }

  std::unique_ptr<FarmClient> Connect(const std::string& first) {
    return ConnectTo({.coordinators = {first, second_.address()},
                      .time = time_.Environment(),
                      .interrupted = test_.environment.interrupted});
  }
  static std::string GoneAddress() {
    const FakeFarm gone;
    return gone.address();
  }
  Backoff MakeBackoff() { return {absl::Minutes(1), time_.Environment(), test_.environment.interrupted}; }
  absl::Status Download() {
    QuietProgress progress(test_.err);
    return DownloadFrame(*farm_, "job-1", 0, folder_.File("part"), progress, MakeBackoff());
  }

  FakeFarm first_;
  FakeFarm second_;
  ScratchFolder folder_;
  TestEnvironment test_;
  FakeTime time_;
  std::unique_ptr<FarmClient> farm_;
};

v1::JobStatus Job(v1::JobState state) {
  v1::JobStatus job;
  job.set_job_id("job-1");
  job.set_state(state);
  return job;
}

TEST_F(FailoverTest, ResumesADownloadAtTheNextCoordinator) {
  first_.break_downloads = {2000};
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), second_.result);
  EXPECT_THAT(first_.download_offsets(), ElementsAre(0));
  EXPECT_THAT(second_.download_offsets(), ElementsAre(2000));
}

TEST_F(FailoverTest, NeverJoinsPiecesOfDifferentFiles) {
  first_.break_downloads = {2000};
  second_.result = std::string(7300, 's');
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), second_.result);
  EXPECT_THAT(second_.download_offsets(), ElementsAre(2000, 0));
}

TEST_F(FailoverTest, DownloadsWhereTheFirstCoordinatorIsGone) {
  farm_ = Connect(GoneAddress());
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), second_.result);
  EXPECT_EQ(time_.sleeps, 0);
}

TEST_F(FailoverTest, UploadsFromWhatTheNextCoordinatorHas) {
  const std::string content(3'000'000, 'w');
  LocalAsset asset;
  asset.path = folder_.Write("wood.png", content);
  ASSERT_TRUE(HashAsset(&asset).ok());
  first_.break_uploads = {2'000'000};
  second_.KeepUpload(asset.ref.sha256(), content.substr(0, 1'000'000));
  QuietProgress progress(test_.err);
  EXPECT_EQ(UploadFile(*farm_, asset, progress, MakeBackoff(), [](uint64_t) {}), absl::OkStatus());
  EXPECT_THAT(first_.upload_offsets(), ElementsAre(0));
  EXPECT_THAT(second_.upload_offsets(), ElementsAre(1'000'000));
  EXPECT_THAT(second_.uploads(), ElementsAre(content));
}

TEST_F(FailoverTest, WatchesAJobAtTheNextCoordinator) {
  first_.watched = {Job(v1::JOB_STATE_RUNNING), Job(v1::JOB_STATE_RUNNING)};
  first_.watched_per_stream = 1;
  second_.watched = {Job(v1::JOB_STATE_FILTERING), Job(v1::JOB_STATE_DONE)};
  QuietProgress progress(test_.err);
  std::vector<v1::JobState> seen;
  const auto job = FollowJob(*farm_, "job-1", progress, MakeBackoff(),
                             [&](const v1::JobStatus& status) { seen.push_back(status.state()); });
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_THAT(seen, ElementsAre(v1::JOB_STATE_RUNNING, v1::JOB_STATE_FILTERING, v1::JOB_STATE_DONE));
}

TEST_F(FailoverTest, WatchesAJobWhereTheFirstCoordinatorIsGone) {
  farm_ = Connect(GoneAddress());
  second_.watched = {Job(v1::JOB_STATE_DONE)};
  QuietProgress progress(test_.err);
  const auto job = FollowJob(*farm_, "job-1", progress, MakeBackoff(), [](const v1::JobStatus&) {});
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(test_.err.str(), "");
  EXPECT_EQ(time_.sleeps, 0);
}

TEST_F(FailoverTest, MakesCallsThatAreNotRepeatedWhereACoordinatorAnswers) {
  farm_ = Connect(GoneAddress());
  second_.jobs = {{"job-1", Job(v1::JOB_STATE_FAILED)}};
  v1::RetryJobRequest request;
  request.set_job_id("job-1");
  EXPECT_TRUE(farm_->RetryJob(request).ok());
  EXPECT_THAT(second_.calls(), testing::Contains(testing::StartsWith("RetryJob")).Times(1));
}

TEST_F(FailoverTest, SubmitsToTheFirstThatAnswers) {
  EXPECT_TRUE(farm_->SubmitJob({}).ok());
  EXPECT_THAT(first_.submissions(), SizeIs(1));
  EXPECT_THAT(second_.submissions(), IsEmpty());
  EXPECT_TRUE(Connect(GoneAddress())->SubmitJob({}).ok());
  EXPECT_THAT(second_.submissions(), SizeIs(1));
}

}  // namespace
}  // namespace lumifold::client
