#include "proto/device/call_messages.h"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <limits>
#include <optional>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "proto/rpc/byte_stream.h"
#include "tests/unit/filter/manifold_inputs.h"

namespace lumifold::device {
namespace {

/// A call that went over a socket.
template <typename Received, typename Call>
std::optional<Received> Transfer(const Call& call) {
  std::array<int, 2> ends = {-1, -1};
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0) return std::nullopt;
  rpc::FileHandle from(ends[0]);
  const rpc::FileHandle to(ends[1]);
  std::thread sender([&] {
    SocketStream stream(from.get());
    (void)SendCall(call, &stream);
    from = {};
  });
  SocketStream stream(to.get());
  std::optional<AnyCall> received = ReceiveCall(&stream);
  shutdown(to.get(), SHUT_RDWR);  // what is refused is not read to its end
  sender.join();
  if (!received.has_value()) return std::nullopt;
  return std::get<Received>(*std::move(received));
}

class CallMessages : public testing::Test {
 protected:
  filter::ManifoldCall Call() const {
    return {input_.signals, input_.features, input_.mask.view(), params_, reach_, &points_};
  }
  bool IsReceived() const { return Transfer<ReceivedFiltering>(Call()).has_value(); }

  CallMessages() { filter::AddSignals(3, &points_); }

  filter::ManifoldInput input_ = filter::MakeManifoldInput(19, 7, 4, true, 3);
  filter::SlicePoints points_ = filter::MakePoints(input_, 2, 2);
  filter::ManifoldParams params_ = {.height = 3, .keeps_mass = true, .is_first_order = true};
  float reach_ = 5;
};

TEST_F(CallMessages, ArriveAsTheyWere) {
  const std::optional<ReceivedFiltering> received = Transfer<ReceivedFiltering>(Call());
  ASSERT_TRUE(received.has_value());
  EXPECT_EQ(received->params.height, 3);
  EXPECT_TRUE(received->params.keeps_mass && received->params.is_first_order);
  EXPECT_EQ(received->reach, 5);
  EXPECT_EQ(received->points->pixels, points_.pixels);
  EXPECT_EQ(received->points->features, points_.features);
  EXPECT_EQ(received->points->signals, points_.signals);
  EXPECT_EQ(received->points->weights, points_.weights);
  for (int y = 0; y < 7; ++y) {
    for (int x = 0; x < 19; ++x) {
      EXPECT_EQ(received->mask.At(x, y), input_.mask.At(x, y));
      EXPECT_EQ(received->signals[2].At(x, y), input_.signals[2].At(x, y));
      EXPECT_EQ(received->features[3].At(x, y), input_.features[3].At(x, y));
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
  points_.own_features = 5;
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

TEST_F(CallMessages, OfProjectionsArriveAsTheyWereOrNotAtAll) {
  std::vector<float> taps(3 * 5 * 9, 0.5f);
  const auto transfer = [&](int radius, int dimensions) {
    return Transfer<ReceivedProjection>(filter::ProjectionCall{input_.signals, radius, dimensions, taps});
  };
  const std::optional<ReceivedProjection> received = transfer(1, 5);
  ASSERT_TRUE(received.has_value());
  EXPECT_EQ(received->radius, 1);
  EXPECT_EQ(received->dimensions, 5);
  EXPECT_EQ(received->taps, taps);
  EXPECT_EQ(received->color[1].At(18, 6), input_.signals[1].At(18, 6));
  EXPECT_FALSE(transfer(2, 5).has_value()) << "more taps than there are";
  EXPECT_FALSE(transfer(-1, 5).has_value());
  EXPECT_FALSE(transfer(1, 0).has_value());
}

}  // namespace
}  // namespace lumifold::device
