#include "server/preview/preview_maker.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <memory>
#include <optional>

#include "proto/rpc/rect_codec.h"

namespace lumifold::server {
namespace {

/// A farm whose previews have one pixel, the units of which are told apart by `units`.
class PreviewMakerTest : public ::testing::Test {
 protected:
  using Result = absl::StatusOr<v1::Preview>;

  PreviewMakerTest() {
    options_.interval = absl::ZeroDuration();
    options_.duty = 1;
    options_.patience = absl::InfiniteDuration();
    options_.count_units = [this](const job::JobId&, int32_t) -> absl::StatusOr<int64_t> {
      if (is_finished_) return absl::FailedPreconditionError("finished");
      return units_.load();
    };
    options_.make = [this](const job::JobId& job, int32_t frame, const PreviewRequest& request) -> Result {
      ++made_;
      if (request.urgent) ++urgent_;
      if (units_ == 0) return absl::OutOfRangeError("no units");
      v1::Preview preview;
      preview.set_units(units_);
      preview.set_width(frame);
      preview.mutable_layout()->set_width(1);
      preview.mutable_layout()->set_height(1);
      for (const char* name : {"R", "G", "B"}) preview.mutable_layout()->add_channels(name);
      preview.set_planes(std::string(12, job.value().back()));
      return preview;
    };
  }
  /// Two previews of a frame are urgent.
  void LeaveTimeForTwo() {
    options_.urgent_time = absl::Milliseconds(30);
    options_.urgent_share = 0;
    options_.make = [make = options_.make](const job::JobId& job, int32_t frame,
                                           const PreviewRequest& request) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      return make(job, frame, request);
    };
  }
  void Start() { maker_ = std::make_unique<PreviewMaker>(options_); }

  std::future<Result> Ask(const std::string& job, int32_t frame = 0, int64_t newer_than = 0,
                          const std::string& layer = "", const std::optional<Rect>& region = std::nullopt) {
    v1::GetPreviewRequest request;
    if (region.has_value()) *request.mutable_region() = rpc::ProtoOf(*region);
    request.set_job_id(job);
    request.set_frame(frame);
    request.set_newer_than_units(newer_than);
    request.set_layer(layer);
    auto promise = std::make_shared<std::promise<Result>>();
    maker_->Get(request, [promise](Result result) { promise->set_value(std::move(result)); });
    return promise->get_future();
  }
  static bool IsWaiting(const std::future<Result>& answer) {
    return answer.wait_for(std::chrono::milliseconds(300)) == std::future_status::timeout;
  }

  PreviewOptions options_;
  std::atomic<int64_t> units_ = 3;
  std::atomic<bool> is_finished_ = false;
  std::atomic<int> made_ = 0;
  std::atomic<int> urgent_ = 0;
  std::unique_ptr<PreviewMaker> maker_;
};

TEST_F(PreviewMakerTest, OnePictureIsForAllWhoLook) {
  Start();
  for (int i = 0; i < 50; ++i) EXPECT_EQ(Ask("j-a").get()->units(), 3);
  EXPECT_EQ(made_, 1);
  EXPECT_EQ(Ask("j-b").get()->planes(), std::string(12, 'b'));
  EXPECT_EQ(Ask("j-a", 7).get()->width(), 7);
  EXPECT_EQ(made_, 3);
}

TEST_F(PreviewMakerTest, WhoHasTheNewestWaitsForMoreUnits) {
  Start();
  std::future<Result> answer = Ask("j-a", 0, 3);
  EXPECT_TRUE(IsWaiting(answer));
  units_ = 5;
  EXPECT_EQ(answer.get()->units(), 5);
}

TEST_F(PreviewMakerTest, TheFirstPicturesAreUrgentAndOthersTakeWhatIsIdle) {
  LeaveTimeForTwo();
  Start();
  for (int64_t units = 3; units < 10; ++units) {
    units_ = units;
    EXPECT_EQ(Ask("j-a", 0, units - 1).get()->units(), units);
  }
  EXPECT_EQ(made_, 7);
  EXPECT_GE(urgent_, 1);
  EXPECT_LE(urgent_, 2);
  EXPECT_EQ(Ask("j-b").get()->units(), 9);
  EXPECT_LE(urgent_, 3) << "each frame has its own";
}

TEST_F(PreviewMakerTest, ThatOfAFinishedFrameIsUrgentAlways) {
  options_.urgent_time = absl::ZeroDuration();
  options_.urgent_share = 0;
  Start();
  for (int64_t units = 3; units < 6; ++units) {
    units_ = units;
    EXPECT_EQ(Ask("j-a", 0, units - 1).get()->units(), units);
  }
  const int before = urgent_;
  units_ = kFinishedUnits;
  EXPECT_EQ(Ask("j-a", 0, 5).get()->units(), kFinishedUnits);
  EXPECT_EQ(urgent_, before + 1);
}

TEST_F(PreviewMakerTest, ARegionIsAPictureOfItsOwn) {
  options_.make = [make = options_.make](const job::JobId& job, int32_t frame,
                                         const PreviewRequest& request) -> Result {
    if (request.region.x1 > 100) return absl::InvalidArgumentError("not within the frame");
    Result preview = make(job, frame, request);
    preview->set_reduction(request.region.width());
    return preview;
  };
  Start();
  EXPECT_EQ(Ask("j-a").get()->reduction(), 0);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(Ask("j-a", 0, 0, "", Rect{3, 4, 13, 14}).get()->reduction(), 10);
    EXPECT_EQ(Ask("j-a", 0, 0, "", Rect{3, 4, 14, 14}).get()->reduction(), 11);
    EXPECT_EQ(Ask("j-a", 0, 0, "", Rect{3, 4, 101, 14}).get().status().message(), "not within the frame");
  }
  EXPECT_EQ(made_, 3);
}

TEST_F(PreviewMakerTest, ARegionThatIsNoneIsRefused) {
  Start();
  for (const Rect& region : {Rect{}, Rect{0, 0, 5, 0}, Rect{5, 5, 5, 9}, Rect{-1, 0, 5, 5},
                             Rect{0, 0, 769, 5}, Rect{-2147483647, 0, 2147483647, 5}})
    EXPECT_TRUE(absl::IsInvalidArgument(Ask("j-a", 0, 0, "", region).get().status()))
        << rpc::RectText(region);
  EXPECT_EQ(made_, 0);
}

TEST_F(PreviewMakerTest, TheTimeOfRegionsIsThatOfTheirFrame) {
  LeaveTimeForTwo();
  Start();
  for (int x = 0; x < 5; ++x) EXPECT_TRUE(Ask("j-a", 0, 0, "", Rect{x, 0, x + 1, 1}).get().ok());
  EXPECT_LE(urgent_, 2);
}

TEST_F(PreviewMakerTest, WhoAsksForALayerThatThereIsNotIsToldSo) {
  Start();
  EXPECT_TRUE(absl::IsInvalidArgument(Ask("j-a", 0, 0, "error").get().status()));
  EXPECT_EQ(made_, 1) << "making it again would not help";
}

TEST_F(PreviewMakerTest, PatienceEnds) {
  options_.patience = absl::Milliseconds(1);
  Start();
  EXPECT_TRUE(absl::IsOutOfRange(Ask("j-a", 0, 3).get().status()));
  units_ = 0;
  EXPECT_TRUE(absl::IsOutOfRange(Ask("j-b").get().status())) << "there is nothing to see yet";
}

TEST_F(PreviewMakerTest, TheEndOfTheFrameIsTold) {
  Start();
  std::future<Result> waits = Ask("j-a", 0, 3);
  EXPECT_TRUE(IsWaiting(waits));
  is_finished_ = true;
  EXPECT_TRUE(absl::IsFailedPrecondition(waits.get().status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(Ask("j-a").get().status()));
}

TEST_F(PreviewMakerTest, ALayerThatThereIsNotIsRefused) {
  Start();
  EXPECT_TRUE(absl::IsInvalidArgument(Ask("j-a", 0, 0, "colour").get().status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Ask("j-a", 0, 0, "colour").get().status()))
      << "of one that is made already";
}

TEST_F(PreviewMakerTest, ErrorsReachThoseWhoWaitAndTheNextOneMayWork) {
  std::atomic<bool> fails = true;
  options_.make = [make = options_.make, &fails](const job::JobId& job, int32_t frame,
                                                 const PreviewRequest& request) -> Result {
    if (fails) return absl::InternalError("out of memory");
    return make(job, frame, request);
  };
  Start();
  EXPECT_EQ(Ask("j-a").get().status(), absl::InternalError("out of memory"));
  fails = false;
  units_ = 4;
  EXPECT_EQ(Ask("j-a").get()->units(), 4);
}

TEST_F(PreviewMakerTest, NoMoreWaitThanAreAllowed) {
  options_.waiting = 2;
  Start();
  const std::future<Result> first = Ask("j-a", 0, 3);
  const std::future<Result> second = Ask("j-a", 0, 3);
  EXPECT_TRUE(absl::IsResourceExhausted(Ask("j-b", 0, 3).get().status()));
}

TEST_F(PreviewMakerTest, OnlyTheLastFramesAreKept) {
  options_.frames = 2;
  Start();
  for (const char* job : {"j-a", "j-b", "j-c", "j-d"}) EXPECT_TRUE(Ask(job).get().ok());
  EXPECT_TRUE(Ask("j-d").get().ok());
  EXPECT_EQ(made_, 4);
  EXPECT_TRUE(Ask("j-a").get().ok());
  EXPECT_EQ(made_, 5) << "the first one was forgotten";
}

TEST_F(PreviewMakerTest, StoppingAnswersAll) {
  std::atomic<bool> cancelled = false;
  options_.cancel = [&cancelled] { cancelled = true; };
  Start();
  std::future<Result> answer = Ask("j-a", 0, 3);
  maker_->Stop();
  EXPECT_TRUE(absl::IsUnavailable(answer.get().status()));
  EXPECT_TRUE(cancelled);
  EXPECT_TRUE(absl::IsUnavailable(Ask("j-a").get().status()));
}

}  // namespace
}  // namespace lumifold::server
