#include "proto/device/call_messages.h"

#include <gtest/gtest.h>

#include <limits>
#include <optional>
#include <vector>

#include "tests/unit/device/transfer.h"
#include "tests/unit/filter/manifold_inputs.h"

namespace lumifold::device {
namespace {

std::optional<ReceivedCall> Transfer(const filter::ManifoldCall& call) {
  return device::Transfer([&](SocketStream* to) { return SendCall(call, to); },
                          [&](SocketStream* from) {
                            return ReceiveOperation(from) == Operation::kFilter ? ReceiveCall(from)
                                                                                : std::nullopt;
                          });
}

class CallMessages : public testing::Test {
 protected:
  filter::ManifoldCall Call() const {
    return {filter::ViewsOf(input_.signals),
            {filter::ViewsOf(input_.signals), radius_, dimensions_, taps_, 1},
            filter::ViewsOf(input_.features),
            input_.mask.view(),
            params_,
            reach_,
            &points_};
  }
  bool IsReceived() const { return Transfer(Call()).has_value(); }

  CallMessages() { filter::AddSignals(3, &points_); }

  filter::ManifoldInput input_ = filter::MakeManifoldInput(19, 150, 4, true, 3);
  filter::SlicePoints points_ = filter::MakePoints(input_, 2, 2);
  filter::ManifoldParams params_ = {.height = 3, .keeps_mass = true, .is_first_order = true};
  float reach_ = 5;
  int radius_ = 1, dimensions_ = 5;
  std::vector<float> taps_ = std::vector<float>(3 * 5 * 9, 0.5f);
};

TEST_F(CallMessages, ArriveAsTheyWere) {
  const ReceivedCall received = Present(Transfer(Call()));
  const filter::ManifoldCall call = received.View();
  EXPECT_EQ(call.params.height, 3);
  EXPECT_TRUE(call.params.keeps_mass && call.params.is_first_order);
  EXPECT_EQ(call.reach, 5);
  EXPECT_EQ(call.patches.radius, 1);
  EXPECT_EQ(call.patches.dimensions, 5);
  EXPECT_EQ(call.patches.taps, absl::MakeConstSpan(taps_));
  EXPECT_EQ(call.points->pixels, points_.pixels);
  EXPECT_EQ(call.points->features, points_.features);
  EXPECT_EQ(call.points->signals, points_.signals);
  EXPECT_EQ(call.points->weights, points_.weights);
  for (int y = 0; y < 150; ++y) {
    for (int x = 0; x < 19; ++x) {
      EXPECT_EQ(call.mask.At(x, y), input_.mask.At(x, y));
      EXPECT_EQ(call.signals[2].At(x, y), input_.signals[2].At(x, y));
      EXPECT_EQ(call.patches.color[1].At(x, y), input_.signals[1].At(x, y));
      EXPECT_EQ(call.features[3].At(x, y), input_.features[3].At(x, y));
    }
  }
}

/// The process with the device is in no sandbox; the caller may be one that a malformed scene has taken over.
TEST_F(CallMessages, OfNoValidCallAreRefused) {
  EXPECT_TRUE(IsReceived());
  points_.pixels.back() = {19, 0};
  EXPECT_FALSE(IsReceived()) << "a point right of the picture";
  points_.pixels.back() = {0, -1};
  EXPECT_FALSE(IsReceived()) << "a point above the picture";
  points_.pixels.back() = {0, 0};
  points_.own_features = 10;
  EXPECT_FALSE(IsReceived()) << "points with more features than pixels have";
  points_.own_features = 2;
  for (const int height : {0, 9}) {
    params_.height = height;
    EXPECT_FALSE(IsReceived()) << "a tree of " << height << " levels";
  }
  params_.height = 3;
  params_.cell = 3;
  EXPECT_FALSE(IsReceived()) << "cells of 3 pixels";
  params_.cell = 0;
  for (const float reach : {0.0f, -1.0f, 1e9f, std::numeric_limits<float>::quiet_NaN()}) {
    reach_ = reach;
    EXPECT_FALSE(IsReceived()) << "a reach of " << reach;
  }
  reach_ = 5;
  input_.signals.pop_back();
  EXPECT_FALSE(IsReceived()) << "planes fitted to two signals";
}

TEST_F(CallMessages, OfNoValidProjectionAreRefused) {
  EXPECT_TRUE(IsReceived());
  radius_ = 2;
  EXPECT_FALSE(IsReceived()) << "more taps than there are";
  radius_ = -1;
  EXPECT_FALSE(IsReceived());
  radius_ = 1;
  dimensions_ = -5;
  EXPECT_FALSE(IsReceived());
}

/// Whatever comes is refused or valid, and kernels stay within what is received: 64 words hold no call.
TEST_F(CallMessages, OfAnyWordsAreRefused) {
  EXPECT_FALSE(AnyIsReceived([](SocketStream* from) { return ReceiveCall(from).has_value(); }));
}

}  // namespace
}  // namespace lumifold::device
