#include "client/farm/upload.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/farm/submit_scene.h"
#include "tests/unit/client/fake_farm.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;

constexpr uint64_t kMiB = uint64_t{1} << 20;

class UploadTest : public testing::Test {
 protected:
  UploadTest() {
    for (uint64_t i = 0; i < 3 * kMiB + 77; ++i) content_ += static_cast<char>(i * 7 + i / 256);
    asset_.path = folder_.Write("wood.png", content_);
    EXPECT_TRUE(HashAsset(&asset_).ok());
  }

  absl::Status Upload() {
    const auto client = MakeFarmClient(farm_.channel(), {.coordinators = {farm_.address()},
                                                         .time = time_.Environment(),
                                                         .interrupted = test_.environment.interrupted});
    QuietProgress progress(test_.err);
    return UploadFile(*client, asset_, progress,
                      Backoff(absl::Minutes(1), time_.Environment(), test_.environment.interrupted),
                      [this](uint64_t sent) { sent_ = sent; });
  }

  FakeFarm farm_;
  ScratchFolder folder_;
  TestEnvironment test_;
  FakeTime time_;
  std::string content_;
  LocalAsset asset_;
  uint64_t sent_ = 0;
};

TEST_F(UploadTest, GoesOnWhereTheCoordinatorStopped) {
  farm_.break_uploads = {kMiB, 2 * kMiB};
  EXPECT_EQ(Upload(), absl::OkStatus());
  EXPECT_THAT(farm_.uploads(), ElementsAre(content_));
  EXPECT_THAT(farm_.upload_offsets(), ElementsAre(0, kMiB, 2 * kMiB));
  EXPECT_EQ(sent_, content_.size());
  EXPECT_THAT(test_.err.str(), testing::EndsWith("broken by the test; trying again\n"));
}

TEST_F(UploadTest, GoesOnWithWhatAnEarlierClientSent) {
  farm_.KeepUpload(asset_.ref.sha256(), content_.substr(0, 1000));
  EXPECT_EQ(Upload(), absl::OkStatus());
  EXPECT_THAT(farm_.uploads(), ElementsAre(content_));
  EXPECT_THAT(farm_.upload_offsets(), ElementsAre(1000));
}

TEST_F(UploadTest, StartsOverOnceWhereTheKeptBytesAreWrong) {
  farm_.KeepUpload(asset_.ref.sha256(), std::string(1000, '?'));
  EXPECT_EQ(Upload(), absl::OkStatus());
  EXPECT_THAT(farm_.uploads(), ElementsAre(content_));
  EXPECT_THAT(farm_.upload_offsets(), ElementsAre(1000, 0));
}

TEST_F(UploadTest, RefusesAFileThatChanged) {
  folder_.Write("wood.png", content_ + "more");
  EXPECT_EQ(Upload().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(farm_.upload_offsets(), ElementsAre(0));
}

TEST_F(UploadTest, GivesUpWhenNothingMoves) {
  farm_.break_uploads.assign(1000, kMiB);
  const absl::Time begin = time_.now;
  EXPECT_EQ(Upload().code(), absl::StatusCode::kUnavailable);
  EXPECT_GE(time_.now - begin, absl::Minutes(1));
  EXPECT_LT(time_.now - begin, absl::Minutes(2));
}

TEST_F(UploadTest, StopsWhenTheUserInterrupts) {
  test_.interrupted = true;
  EXPECT_EQ(Upload(), absl::CancelledError("interrupted"));
}

}  // namespace
}  // namespace lumifold::client
