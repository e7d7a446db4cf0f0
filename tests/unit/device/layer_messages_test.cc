#include "proto/device/layer_messages.h"

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "tests/unit/device/transfer.h"
#include "tests/unit/filter/manifold_inputs.h"

namespace lumifold::device {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// A layer with points and fireflies, filtered by two ranges.
class LayerMessages : public testing::Test {
 protected:
  LayerMessages() {
    for (filter::SlicePoints& of_half : points_) filter::AddSignals(3, &of_half);
    const size_t count = points_[0].pixels.size();
    for (size_t h = 0; h < 2; ++h) {
      uncut_[h] = std::vector<float>(3 * count, 0.25f + static_cast<float>(h));
      coverage_[h] = std::vector<float>(count, 0.5f + static_cast<float>(h));
    }
    const filter::PlaneViews light = filter::ViewsOf(input_.signals), other = filter::ViewsOf(other_.signals);
    call_.halves.light = {light, other};
    call_.halves.masks = {input_.mask.view(), other_.mask.view()};
    call_.halves.weight = input_.mask.view();
    call_.halves.share_a = input_.features[0].view();
    call_.halves.samples = input_.features[1].view();
    call_.halves.is_mixed = other_.features[2].view();
    call_.geometry = filter::ViewsOf(input_.features);
    call_.halves.level = 0.75f;
    call_.points.of_halves = {points_.data(), &points_[1]};
    call_.points.uncut = {uncut_[0], uncut_[1]};
    call_.points.coverage = {coverage_[0], coverage_[1]};
    call_.points.offsets = offsets_;
    call_.points.weights = coverage_[0];
    call_.points.samples = coverage_[1];
    call_.knee = 0.2f;
    call_.reach_px = 12;
    call_.first = {{.height = 3, .is_first_order = true}, {}, 1.5f, {1}};
    call_.further = {{.height = 2}, {.radius = 1}, 0.5f, {1, 2}};
    call_.fit = fit_;
    removed_.planes = {other, light};
    call_.removed = removed_;
  }

  std::optional<ReceivedLayer> Received() const {
    return Transfer([&](SocketStream* to) { return SendLayer(call_, to); },
                    [&](SocketStream* from) {
                      return ReceiveOperation(from) == Operation::kLayer ? ReceiveLayer(from) : std::nullopt;
                    });
  }
  /// What is not received, callers do not send.
  void ExpectRefused(const char* why) const {
    EXPECT_FALSE(CanSend(call_)) << why;
    EXPECT_FALSE(Received().has_value()) << why;
  }
  /// With each of these in place of a number.
  template <typename T>
  void ExpectRefused(T* number, std::initializer_list<T> wrong, const char* why) const {
    const T valid = *number;
    for (const T value : wrong) {
      *number = value;
      ExpectRefused(why);
    }
    *number = valid;
  }

  filter::ManifoldInput input_ = filter::MakeManifoldInput(19, 50, 4, true, 3);
  filter::ManifoldInput other_ = filter::MakeManifoldInput(19, 50, 4, true, 4);
  std::array<filter::SlicePoints, 2> points_ = {filter::MakePoints(input_, 2, 2),
                                                filter::MakePoints(input_, 2, 2)};
  std::array<std::vector<float>, 2> uncut_, coverage_;
  std::vector<float> offsets_ = std::vector<float>(2 * points_[0].pixels.size(), 0.125f);
  filter::RegressionParams fit_ = {3, 0.5f, 2};
  filter::RemovedLight removed_ = {.planes = {}, .returns = true, .spread_light = 2, .spread_height = 3};
  filter::LayerCall call_;
};

TEST_F(LayerMessages, ArriveAsTheyWere) {
  const ReceivedLayer received = Present(Received());
  const filter::LayerCall call = received.View();
  EXPECT_EQ(call.halves.light[1][2].At(3, 40), other_.signals[2].At(3, 40));
  EXPECT_EQ(call.halves.masks[1].At(3, 40), other_.mask.At(3, 40));
  EXPECT_EQ(call.halves.weight.At(3, 40), input_.mask.At(3, 40));
  EXPECT_EQ(call.halves.share_a.At(3, 40), input_.features[0].At(3, 40));
  EXPECT_EQ(call.halves.samples.At(3, 40), input_.features[1].At(3, 40));
  EXPECT_EQ(call.halves.is_mixed.At(3, 40), other_.features[2].At(3, 40));
  EXPECT_TRUE(call.halves.picture_light.IsEmpty() && call.halves.expected_difference.IsEmpty());
  ASSERT_EQ(call.geometry.size(), 4);
  EXPECT_EQ(call.geometry[3].At(3, 40), input_.features[3].At(3, 40));
  EXPECT_EQ(call.points.of_halves[1]->weights, points_[1].weights);
  EXPECT_EQ(call.points.of_halves[1]->pixels, points_[1].pixels);
  EXPECT_EQ(call.points.uncut[1], absl::MakeConstSpan(uncut_[1]));
  EXPECT_EQ(call.points.coverage[1], absl::MakeConstSpan(coverage_[1]));
  EXPECT_EQ(call.points.offsets, absl::MakeConstSpan(offsets_));
  EXPECT_EQ(call.points.samples, absl::MakeConstSpan(coverage_[1]));
  EXPECT_TRUE(CanSend(call_));
}

TEST_F(LayerMessages, HaveTheirNumbers) {
  const filter::LayerCall call = Present(Received()).call;
  EXPECT_EQ(call.halves.level, 0.75f);
  EXPECT_EQ(call.knee, 0.2f);
  EXPECT_EQ(call.reach_px, 12);
  EXPECT_EQ(call.first.manifolds.height, 3);
  EXPECT_EQ(call.first.patches.radius, 3);
  EXPECT_EQ(call.first.patches.explained_variance, 0.95);
  EXPECT_EQ(call.first.sigma_q, 1.5f);
  EXPECT_EQ(call.further.patches.radius, 1);
  EXPECT_EQ(call.further.scales, (std::vector<float>{1, 2}));
  EXPECT_EQ(call.choice.widest_radius, 48);
  EXPECT_EQ(call.choice.blend_radius, 4);
  EXPECT_EQ(call.choice.significance, 9);
  EXPECT_EQ(Present(call.fit).slope, 2);
  EXPECT_EQ(Present(call.removed).spread_light, 2);
  EXPECT_TRUE(Present(call.removed).returns && call.may_stay_noisy);
}

TEST_F(LayerMessages, MayHaveNeitherPointsNorFireflies) {
  call_.points = {};
  call_.fit = std::nullopt;
  call_.removed = std::nullopt;
  call_.further.scales = {};
  EXPECT_TRUE(CanSend(call_));
  const ReceivedLayer received = Present(Received());
  const filter::LayerCall call = received.View();
  EXPECT_FALSE(call.fit.has_value() || call.removed.has_value());
  EXPECT_EQ(call.points.Count(), 0);
  EXPECT_EQ(call.halves.light[1][2].At(3, 40), other_.signals[2].At(3, 40));
}

TEST_F(LayerMessages, OfNoValidNumbersAreRefused) {
  filter::ChoiceParams& choice = call_.choice;
  for (int* const radius :
       {&choice.widest_radius, &choice.wide_radius, &choice.narrow_radius, &choice.blend_radius})
    ExpectRefused(radius, {-1, 1 << 20}, "a window of no size");
  for (const float sigma : {0.0f, -1.0f, 41.0f, kNaN}) {
    fit_.sigma_px = sigma;
    call_.fit = fit_;
    ExpectRefused("a fit over windows of no size");
  }
  fit_.sigma_px = 3;
  call_.fit = fit_;
  ExpectRefused(&call_.halves.level, {kNaN}, "light of no level");
  ExpectRefused(&call_.knee, {kNaN}, "a guide of no knee");
  ExpectRefused(&call_.reach_px, {0.0f, -1.0f, 1e9f, kNaN}, "a blur of no reach");
  for (const int levels : {0, 9}) {
    removed_.spread_height = levels;
    call_.removed = removed_;
    ExpectRefused("energy by a tree of no levels");
  }
  removed_.spread_height = 3;
  call_.removed = removed_;
  for (filter::GuidedHalves* halves : {&call_.first, &call_.further}) {
    ExpectRefused(&halves->manifolds.height, {0, 9}, "a tree of no levels");
    ExpectRefused(&halves->manifolds.cell, {-1, 3, 128}, "cells of no size");
    ExpectRefused(&halves->patches.radius, {-1, 9}, "patches of no size");
    ExpectRefused(&halves->patches.most_dimensions, {-1, 17}, "coordinates of no number");
    ExpectRefused(&halves->scales.front(), {kNaN}, "coordinates of no scale");
  }
  call_.first.scales = {1, 2};
  ExpectRefused("two first filterings");
  call_.first.scales = {1};
  call_.further.scales.resize(9, 1);
  ExpectRefused("nine further filterings");
}

TEST_F(LayerMessages, OfNoValidLayerAreRefused) {
  const ConstFloatView mixed = call_.halves.is_mixed;
  call_.halves.is_mixed = {};
  ExpectRefused("a fit without mixed pixels");
  call_.halves.is_mixed = mixed;
  const filter::PlaneViews geometry = call_.geometry;
  call_.geometry.clear();
  ExpectRefused("a layer without geometry");
  call_.geometry = geometry;
  for (filter::SlicePoints& of_half : points_) of_half.own_features = 5;
  ExpectRefused("points with more features than the geometry");
  for (filter::SlicePoints& of_half : points_) of_half.own_features = 2;
  points_[1].pixels.pop_back();
  points_[1].features.resize(points_[1].features.size() - points_[1].own_features);
  points_[1].signals.resize(points_[1].signals.size() - 3);
  points_[1].weights.pop_back();
  ExpectRefused("halves with points of their own");
}

/// Whatever comes is refused or valid, and kernels stay within what is received: 64 words hold no layer.
TEST_F(LayerMessages, OfAnyWordsAreRefused) {
  EXPECT_FALSE(AnyIsReceived([](SocketStream* from) { return ReceiveLayer(from).has_value(); }));
}

}  // namespace
}  // namespace lumifold::device
