#include "proto/device/call_messages.h"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <limits>
#include <optional>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "filter/image/check.h"
#include "proto/rpc/byte_stream.h"
#include "tests/unit/filter/manifold_inputs.h"

namespace lumifold::device {
namespace {

/// What receive() makes of a message that went over a socket.
template <typename Send, typename Receive>
auto Transfer(const Send& send, const Receive& receive)
    -> decltype(receive(static_cast<SocketStream*>(nullptr))) {
  std::array<int, 2> ends = {-1, -1};
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0) return {};
  rpc::FileHandle from(ends[0]);
  const rpc::FileHandle to(ends[1]);
  std::thread sender([&] {
    SocketStream stream(from.get());
    (void)send(&stream);
    from = {};
  });
  SocketStream stream(to.get());
  auto received = receive(&stream);
  shutdown(to.get(), SHUT_RDWR);  // what is refused is not read to its end
  sender.join();
  return received;
}

/// The value, which must be there.
template <typename Value>
Value Present(std::optional<Value> value) {
  LUMIFOLD_CHECK(value.has_value());
  return *std::move(value);
}

/// Both ends of a connection that has kept planes.
struct Connection {
  SentPlanes sent;
  KeptPlanesOfCaller kept;

  std::optional<ReceivedCalls> Transfer(const std::vector<filter::ManifoldCall>& calls) {
    return device::Transfer([&](SocketStream* to) { return SendCalls(calls, &sent, to); },
                            [&](SocketStream* from) {
                              return ReceiveOperation(from) == Operation::kFilter ? ReceiveCalls(&kept, from)
                                                                                  : std::nullopt;
                            });
  }
};

std::optional<ReceivedCalls> Transfer(const std::vector<filter::ManifoldCall>& calls) {
  return Connection().Transfer(calls);
}

class CallMessages : public testing::Test {
 protected:
  filter::ManifoldCall Call() const {
    return {filter::ViewsOf(input_.signals),
            {},
            {filter::ViewsOf(input_.signals), radius_, dimensions_, taps_, 1, inverse_knee_, 0.5f},
            filter::ViewsOf(input_.features),
            input_.mask.view(),
            params_,
            reach_,
            &points_};
  }
  bool IsReceived() const { return Transfer({Call()}).has_value(); }

  CallMessages() { filter::AddSignals(3, &points_); }

  filter::ManifoldInput input_ = filter::MakeManifoldInput(19, 150, 4, true, 3);
  filter::SlicePoints points_ = filter::MakePoints(input_, 2, 2);
  filter::ManifoldParams params_ = {.height = 3, .keeps_mass = true, .is_first_order = true};
  float reach_ = 5;
  int radius_ = 1, dimensions_ = 5;
  float inverse_knee_ = 2;
  std::vector<float> taps_ = std::vector<float>(3 * 5 * 9, 0.5f);
};

TEST_F(CallMessages, ArriveAsTheyWere) {
  const ReceivedCalls received = Present(Transfer({Call()}));
  const filter::ManifoldCall call = received.View().front();
  EXPECT_EQ(call.params.height, 3);
  EXPECT_TRUE(call.params.keeps_mass && call.params.is_first_order);
  EXPECT_EQ(call.reach, 5);
  EXPECT_EQ(call.patches.radius, 1);
  EXPECT_EQ(call.patches.dimensions, 5);
  EXPECT_EQ(call.patches.inverse_knee, 2);
  EXPECT_EQ(call.patches.shift, 0.5f);
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

TEST_F(CallMessages, OfSeveralCallsHaveEachPlaneOnce) {
  const filter::ManifoldInput other = filter::MakeManifoldInput(19, 150, 1, true, 4);
  filter::ManifoldCall second = Call();
  second.signals = filter::ViewsOf(other.signals);
  second.patches.scale = 2;
  second.points = nullptr;
  filter::ManifoldCall third = Call(), fourth = Call();
  filter::SlicePoints placed = points_;  // the same ones of another half
  placed.signals.front() += 1;
  fourth.points = &placed;
  const ReceivedCalls received = Present(Transfer({Call(), second, third, fourth}));
  EXPECT_EQ(received.planes.size(), 3 + 4 + 1 + 3);
  const std::vector<filter::ManifoldCall> calls = received.View();
  ASSERT_EQ(calls.size(), 4);
  EXPECT_EQ(calls[1].signals[0].At(3, 2), other.signals[0].At(3, 2));
  EXPECT_EQ(calls[1].features[0].Row(0), calls[0].features[0].Row(0));
  EXPECT_EQ(calls[1].patches.scale, 2);
  EXPECT_EQ(calls[1].points, nullptr);
  EXPECT_EQ(calls[2].points, calls[0].points);
  EXPECT_EQ(calls[3].points->pixels, points_.pixels);
  EXPECT_EQ(calls[3].points->features, points_.features);
  EXPECT_EQ(calls[3].points->signals, placed.signals);
}

TEST_F(CallMessages, SendAPlaneThatIsKeptOnce) {
  Connection connection;
  const filter::PlaneViews kept = filter::ViewsOf(input_.features);
  connection.sent.Keep(kept);
  const float first = input_.features[3].At(4, 100);
  ASSERT_TRUE(connection.Transfer({Call()}).has_value());
  EXPECT_EQ(connection.kept.size(), 4);
  input_.features[3].At(4, 100) = first + 1;  // which a caller must not do: the other end has it as it was
  ReceivedCalls received = Present(connection.Transfer({Call()}));
  EXPECT_EQ(received.planes.size(), 3 + 1);
  EXPECT_EQ(received.View().front().features[3].At(4, 100), first);
  connection.sent.Forget(kept);
  received = Present(connection.Transfer({Call()}));
  EXPECT_EQ(received.View().front().features[3].At(4, 100), first + 1);
  EXPECT_TRUE(connection.kept.empty());
}

TEST_F(CallMessages, OfKeptPlanesThatAreNotThereAreRefused) {
  Connection connection;
  connection.sent.Keep(filter::ViewsOf(input_.features));
  ASSERT_TRUE(connection.Transfer({Call()}).has_value());
  EXPECT_TRUE(connection.Transfer({Call()}).has_value());
  connection.kept.begin()->second = Plane(7, 5);
  EXPECT_FALSE(connection.Transfer({Call()}).has_value()) << "a plane of another size";
  connection.kept.clear();
  EXPECT_FALSE(connection.Transfer({Call()}).has_value()) << "a plane that was never sent";
  SentPlanes others;
  others.Keep(filter::ViewsOf(input_.signals));  // with a number that is taken
  ASSERT_TRUE(Connection().Transfer({Call()}).has_value());
  connection.kept.emplace(1, Plane(19, 150));
  connection.sent = others;
  EXPECT_FALSE(connection.Transfer({Call()}).has_value()) << "a plane in another's place";
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
  inverse_knee_ = std::numeric_limits<float>::infinity();
  EXPECT_FALSE(IsReceived()) << "guides over a knee of 0";
  inverse_knee_ = 0;
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

/// Whatever comes is refused or valid, and kernels stay within what is received.
TEST_F(FitMessages, OfAnyWordsAreRefusedOrValid) {
  std::mt19937 random(7);
  for (int i = 0; i < 300; ++i) {
    std::vector<uint32_t> words(64);
    for (uint32_t& word : words) word = static_cast<uint32_t>(random() >> (random() % 32));
    const auto send = [&](SocketStream* to) { return to->Write(words.data(), 4 * words.size()); };
    const bool is_fit = i % 2 == 0;
    const auto receive = [&](SocketStream* from) {
      KeptPlanesOfCaller kept;
      return is_fit ? ReceiveFit(from).has_value() : ReceiveCalls(&kept, from).has_value();
    };
    EXPECT_FALSE(Transfer(send, receive)) << i;  // 64 words hold no call
  }
}

}  // namespace
}  // namespace lumifold::device
