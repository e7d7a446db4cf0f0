#include "proto/device/refine_messages.h"

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

/// A layer with points, filtered by two ranges.
class RefineMessages : public testing::Test {
 protected:
  RefineMessages() {
    for (filter::SlicePoints& of_half : points_) filter::AddSignals(3, &of_half);
    for (size_t h = 0; h < 2; ++h) {
      lists_[h] = std::vector<float>(3 * points_[0].pixels.size(), 0.25f + static_cast<float>(h));
      coverage_[h] = std::vector<float>(points_[0].pixels.size(), 0.5f);
    }
  }

  std::vector<filter::ManifoldCall> Filterings() const {
    std::vector<filter::ManifoldCall> calls;
    calls.reserve(filterings_);
    for (size_t i = 0; i < filterings_; ++i) {
      calls.push_back({filter::ViewsOf(input_.signals),
                       filter::ViewsOf(input_.signals),
                       {},
                       filter::ViewsOf(input_.features),
                       input_.mask.view(),
                       params_,
                       5,
                       &points_[i / 2 % 2]});
    }
    return calls;
  }
  filter::RefineCall Call(const std::vector<filter::ManifoldCall>& filterings) const {
    return {.filterings = filterings,
            .choice = choice_,
            .fit = has_fit_ ? std::optional(fit_) : std::nullopt,
            .level = level_,
            .weight = input_.mask.view(),
            .samples = input_.features[0].view(),
            .light = {},
            .expected = {},
            .mixed = has_mixed_ ? input_.features[1].view() : ConstFloatView{},
            .noisy = {lists_[0], lists_[1]},
            .base = {lists_[1], lists_[0]},
            .coverage = {coverage_[0], coverage_[1]},
            .offsets = offsets_,
            .point_weights = coverage_[0],
            .point_samples = coverage_[1]};
  }
  std::optional<ReceivedRefinement> Received() const {
    SentPlanes sent;
    KeptPlanesOfCaller kept;
    const std::vector<filter::ManifoldCall> filterings = Filterings();
    return Transfer([&](SocketStream* to) { return SendRefinement(Call(filterings), &sent, to); },
                    [&](SocketStream* from) {
                      return ReceiveOperation(from) == Operation::kRefine ? ReceiveRefinement(&kept, from)
                                                                          : std::nullopt;
                    });
  }
  /// What is not received, callers do not send.
  void ExpectRefused(const char* why) const {
    const std::vector<filter::ManifoldCall> filterings = Filterings();
    EXPECT_FALSE(CanSend(Call(filterings))) << why;
    EXPECT_FALSE(Received().has_value()) << why;
  }

  filter::ManifoldInput input_ = filter::MakeManifoldInput(19, 50, 4, true, 3);
  std::array<filter::SlicePoints, 2> points_ = {filter::MakePoints(input_, 2, 2),
                                                filter::MakePoints(input_, 2, 2)};
  filter::ManifoldParams params_ = {.height = 3, .keeps_mass = true};
  size_t filterings_ = 4;
  filter::ChoiceParams choice_;
  filter::LightFit fit_ = {{3, 0.5f, 2}, 0.2f};
  bool has_fit_ = true, has_mixed_ = true;
  float level_ = 0.75f;
  std::array<std::vector<float>, 2> lists_, coverage_;
  std::vector<float> offsets_ = std::vector<float>(2 * points_[0].pixels.size(), 0.125f);
};

TEST_F(RefineMessages, ArriveAsTheyWere) {
  const ReceivedRefinement received = Present(Received());
  const std::vector<filter::ManifoldCall> filterings = received.filterings.View();
  const filter::RefineCall call = received.View(filterings);
  ASSERT_EQ(call.filterings.size(), 4);
  EXPECT_EQ(call.filterings[3].points->weights, points_[1].weights);
  EXPECT_EQ(call.choice.widest_radius, 48);
  EXPECT_EQ(call.choice.blend_radius, 4);
  EXPECT_EQ(call.choice.significance, 9);
  EXPECT_EQ(call.level, 0.75f);
  const filter::LightFit fit = Present(call.fit);
  EXPECT_EQ(fit.params.sigma_px, 3);
  EXPECT_EQ(fit.params.sigma_light, 0.5f);
  EXPECT_EQ(fit.params.slope, 2);
  EXPECT_EQ(fit.knee, 0.2f);
  EXPECT_EQ(call.weight.At(3, 40), input_.mask.At(3, 40));
  EXPECT_EQ(call.samples.At(3, 40), input_.features[0].At(3, 40));
  EXPECT_EQ(call.mixed.At(3, 40), input_.features[1].At(3, 40));
  EXPECT_TRUE(call.light.IsEmpty() && call.expected.IsEmpty());
  EXPECT_EQ(call.noisy[1], absl::MakeConstSpan(lists_[1]));
  EXPECT_EQ(call.base[1], absl::MakeConstSpan(lists_[0]));
  EXPECT_EQ(call.offsets, absl::MakeConstSpan(offsets_));
  EXPECT_EQ(call.point_samples, absl::MakeConstSpan(coverage_[1]));
  const std::vector<filter::ManifoldCall> sent = Filterings();
  EXPECT_TRUE(CanSend(Call(sent)));
  has_fit_ = false;
  EXPECT_FALSE(Present(Received()).call.fit.has_value());
}

TEST_F(RefineMessages, OfNoValidRefinementAreRefused) {
  filterings_ = 3;
  ExpectRefused("three filterings of two halves");
  filterings_ = 4;
  for (int* const radius :
       {&choice_.widest_radius, &choice_.wide_radius, &choice_.narrow_radius, &choice_.blend_radius}) {
    const int valid = *radius;
    for (const int wrong : {-1, 1 << 20}) {
      *radius = wrong;
      ExpectRefused("a window of no size");
    }
    *radius = valid;
  }
  for (const float sigma : {0.0f, -1.0f, 41.0f, std::numeric_limits<float>::quiet_NaN()}) {
    fit_.params.sigma_px = sigma;
    ExpectRefused("a fit over windows of no size");
  }
  fit_.params.sigma_px = 3;
  has_mixed_ = false;
  ExpectRefused("a fit without mixed pixels");
  has_mixed_ = true;
  for (filter::SlicePoints& of_half : points_) of_half.own_features = 5;
  ExpectRefused("points with more features than the geometry");
  for (filter::SlicePoints& of_half : points_) of_half.own_features = 2;
  level_ = std::numeric_limits<float>::quiet_NaN();
  ExpectRefused("light of no level");
  level_ = 1;
  points_[1].pixels.pop_back();
  points_[1].features.resize(points_[1].features.size() - points_[1].own_features);
  points_[1].signals.resize(points_[1].signals.size() - 3);
  points_[1].weights.pop_back();
  ExpectRefused("halves with points of their own");
}

TEST_F(RefineMessages, OfAnyWordsAreRefused) {
  EXPECT_FALSE(AnyIsReceived([](SocketStream* from) {
    KeptPlanesOfCaller kept;
    return ReceiveRefinement(&kept, from).has_value();
  }));
}

}  // namespace
}  // namespace lumifold::device
