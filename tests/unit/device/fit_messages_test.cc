#include "proto/device/fit_messages.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "proto/device/call_messages.h"
#include "tests/unit/device/transfer.h"

namespace lumifold::device {
namespace {

/// Samples of a picture of 4 x 3 pixels: none of the first, two of the last, one of each other.
class FitMessages : public testing::Test {
 protected:
  FitMessages() : samples_(12 * static_cast<size_t>(filter::FitShape{3, 2, 4}.Sample()), 0.5f) {}

  std::optional<ReceivedFit> Received() const {
    const filter::FitCall call = {shape_, width_, 3, radius_, 0.1f, 4, firsts_, samples_, targets_};
    return Transfer([&](SocketStream* to) { return SendFit(call, to); },
                    [&](SocketStream* from) {
                      return ReceiveOperation(from) == Operation::kFit ? ReceiveFit(from) : std::nullopt;
                    });
  }

  filter::FitShape shape_ = {3, 2, 4};
  int32_t width_ = 4, radius_ = 2;
  std::vector<int32_t> firsts_ = {0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12};
  std::vector<float> samples_;
  std::vector<int32_t> targets_ = {0, 3, 11};
};

TEST_F(FitMessages, ArriveAsTheyWereWithThePlacesOfSamples) {
  const ReceivedFit received = Present(Received());
  const filter::FitCall call = received.View();
  EXPECT_EQ(call.shape, shape_);
  EXPECT_EQ(call.radius, 2);
  EXPECT_EQ(call.slope, 4);
  EXPECT_EQ(call.firsts, absl::MakeConstSpan(firsts_));
  EXPECT_EQ(call.targets, absl::MakeConstSpan(targets_));
  const float* const last = call.Sample(12 - 1) + shape_.Sample();
  EXPECT_EQ(last[-3], 0.5f);
  EXPECT_EQ(last[-2], 3);
  EXPECT_EQ(last[-1], 2);
}

TEST_F(FitMessages, OfNoValidFitAreRefused) {
  const std::vector<int32_t> firsts = firsts_, targets = targets_;
  for (const std::vector<int32_t>& wrong : {std::vector<int32_t>{0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 13},
                                            {1, 1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12},
                                            {0, 5, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12},
                                            {0, -1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12}}) {
    firsts_ = wrong;
    EXPECT_FALSE(Received().has_value());
  }
  firsts_ = firsts;
  for (const std::vector<int32_t>& wrong : {std::vector<int32_t>{3, 0}, {3, 3}, {-1}, {12}}) {
    targets_ = wrong;
    EXPECT_FALSE(Received().has_value());
  }
  targets_ = targets;
  for (const filter::FitShape wrong : {filter::FitShape{0, 2, 4}, {3, -2, 4}, {3, 2, 3}, {3, 2, 400}}) {
    shape_ = wrong;
    EXPECT_FALSE(Received().has_value());
  }
  shape_ = {3, 2, 4};
  width_ = 0;
  EXPECT_FALSE(Received().has_value());
  width_ = 4;
  radius_ = -1;
  EXPECT_FALSE(Received().has_value());
  radius_ = 2;
  EXPECT_TRUE(Received().has_value());
}

TEST_F(FitMessages, HoldABlockOfWhichEachPixelIsFitted) {
  constexpr int32_t kSide = 1536;
  constexpr size_t kPixels = size_t{kSide} * kSide;
  const filter::FitShape shape = {8, 8, 12};
  const float none = 0;  // no sample is read
  const filter::FitCall call = {
      shape, kSide, kSide, 6, 0.1f, 4, {}, {&none, 2 * kPixels * static_cast<size_t>(shape.Sample())}, {}};
  EXPECT_TRUE(CanSend(call));
}

TEST_F(FitMessages, OfAnyWordsAreRefused) {
  EXPECT_FALSE(AnyIsReceived([](SocketStream* from) { return ReceiveFit(from).has_value(); }));
}

}  // namespace
}  // namespace lumifold::device
