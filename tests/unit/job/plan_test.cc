#include "server/job/plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include "server/job/job_spec.h"
#include "server/job/limits.h"
#include "server/job/tile_grid.h"
#include "tests/support/made_up_plan.h"

namespace lumifold::job {
namespace {

using ::testing::HasSubstr;

/// As a client submits it.
v1::JobSpec Submitted() {
  v1::JobSpec spec;
  spec.set_width(40);
  spec.set_height(30);
  spec.set_samples_per_pixel(10);
  spec.set_frame_count(3);
  spec.set_max_bounces(4);
  return spec;
}

v1::JobSpec Forcing(const std::string& forced) {
  v1::JobSpec spec = Submitted();
  spec.mutable_planning()->add_forced(forced);
  return spec;
}

v1::PlanDecision* Find(v1::Plan& plan, const std::string& name) {
  for (v1::PlanDecision& decision : *plan.mutable_decisions()) {
    if (decision.name() == name) return &decision;
  }
  return nullptr;
}

std::string ErrorOf(const v1::Plan& plan, const v1::JobSpec& submitted = Submitted()) {
  const absl::StatusOr<v1::JobSpec> planned = PlannedSpec(*NormaliseJobSpec(submitted), plan);
  EXPECT_EQ(planned.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(planned.status().message());
}

TEST(JobPlan, AJobWithoutAPlanHasOneUnit) {
  const absl::StatusOr<v1::JobSpec> spec = NormaliseJobSpec(Submitted());
  ASSERT_TRUE(spec.ok()) << spec.status();
  EXPECT_TRUE(NeedsPlan(*spec));
  EXPECT_EQ(spec->tile_size(), 0);
  EXPECT_EQ(spec->pass_samples(), 0);
  const FrameUnits units(*spec);
  EXPECT_EQ(units.count(), 1);
  const UnitKey key = {0, 0, 0, v1::UNIT_KIND_PLAN};
  EXPECT_EQ(units.KeyOf(0, 0), key);
  EXPECT_EQ(units.NumberOf(key), 0);
  EXPECT_EQ(units.KindOf(0), v1::UNIT_KIND_PLAN);
  EXPECT_EQ(units.CameraSamplesOf(key), 0);
  EXPECT_EQ(units.tiles().RectOf(0), (Rect{0, 0, 40, 30}));
  for (const v1::UnitKind kind : {v1::UNIT_KIND_GEOMETRY, v1::UNIT_KIND_PASS})
    EXPECT_FALSE(units.NumberOf({0, 0, 0, kind}).has_value());
  EXPECT_EQ(Describe({JobId("j-1"), key}), "j-1 plan");
}

TEST(JobPlan, ThePlanDividesTheJob) {
  const v1::JobSpec spec = *NormaliseJobSpec(Submitted());
  const absl::StatusOr<v1::JobSpec> planned = PlannedSpec(spec, MadeUpPlan(16, 6));
  ASSERT_TRUE(planned.ok()) << planned.status();
  EXPECT_FALSE(NeedsPlan(*planned));
  EXPECT_EQ(planned->tile_size(), 16);
  EXPECT_EQ(planned->pass_samples(), 6);
  EXPECT_EQ(planned->first_pass_samples(), 2);
  EXPECT_EQ(FrameUnits(*planned).count(), 6 * (1 + 3));
  EXPECT_FALSE(FrameUnits(*planned).NumberOf({0, 0, 0, v1::UNIT_KIND_PLAN}).has_value());
  EXPECT_EQ(ValueOf(*planned, "bounces"), 0);
  EXPECT_EQ(ValueOf(spec, "levels"), 3) << "without a plan everything is modelled";
  EXPECT_EQ(NormaliseJobSpec(*planned)->SerializeAsString(), planned->SerializeAsString());
  EXPECT_EQ(UnplannedSpec(*planned).SerializeAsString(), spec.SerializeAsString());
  EXPECT_EQ(PlannedSpec(spec, MadeUpPlan(16, 0))->pass_samples(), kMinDefaultPassSamples) << "the default";
}

TEST(JobPlan, WhatTheJobAsksForWins) {
  v1::JobSpec submitted = Submitted();
  submitted.set_tile_size(24);
  v1::Plan plan = MadeUpPlan(16, 6);
  EXPECT_EQ(ErrorOf(plan, submitted), "plan: tile-size is 16, but the job asks for 24");
  Find(plan, "tile-size")->set_value(24);
  EXPECT_EQ(ErrorOf(plan, submitted), "plan: tile-size has the wrong source");
  Find(plan, "tile-size")->set_source(v1::DECISION_SOURCE_FORCED);
  const v1::JobSpec spec = *NormaliseJobSpec(submitted);
  const absl::StatusOr<v1::JobSpec> planned = PlannedSpec(spec, plan);
  ASSERT_TRUE(planned.ok()) << planned.status();
  EXPECT_EQ(planned->tile_size(), 24);
  EXPECT_EQ(planned->pass_samples(), 6);
  EXPECT_EQ(UnplannedSpec(*planned).SerializeAsString(), spec.SerializeAsString());
  EXPECT_EQ(ErrorOf(MadeUpPlan(), Forcing("glossy=off")), "plan: glossy is 1, but the job asks for 0");
}

TEST(JobPlan, APlanThatIsNotValidIsRefused) {
  v1::Plan plan;
  EXPECT_EQ(ErrorOf(plan), "plan: it has 0 decisions, not 13");
  plan = MadeUpPlan();
  plan.mutable_decisions()->SwapElements(1, 2);
  EXPECT_THAT(ErrorOf(plan), HasSubstr("'levels' is missing or out of order"));
  plan = MadeUpPlan();
  Find(plan, "levels")->set_value(4);
  EXPECT_EQ(ErrorOf(plan), "plan: levels is 4, not 0 to 3");
  plan = MadeUpPlan();
  Find(plan, "bounces")->set_value(5);
  EXPECT_EQ(ErrorOf(plan), "plan: more bounces than the job asks for");
  plan = MadeUpPlan();
  Find(plan, "direct")->set_source(v1::DECISION_SOURCE_FORCED);
  EXPECT_EQ(ErrorOf(plan), "plan: direct has the wrong source");
  plan = MadeUpPlan();
  Find(plan, "direct")->set_reason(std::string(kMaxPlanTextBytes + 1, 'x'));
  EXPECT_THAT(ErrorOf(plan), HasSubstr("a text of direct has more than"));
  EXPECT_THAT(ErrorOf(MadeUpPlan(8, 5)), HasSubstr("not even"));
  plan = MadeUpPlan();
  plan.set_noise(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THAT(ErrorOf(plan), HasSubstr("not finite"));
  plan = MadeUpPlan();
  plan.set_probe_rays(-1);
  EXPECT_THAT(ErrorOf(plan), HasSubstr("negative"));
  plan = MadeUpPlan();
  for (size_t i = 0; i < kMaxPlanBytes; ++i) plan.add_tile_order(0);
  EXPECT_THAT(ErrorOf(plan), HasSubstr("bytes, more than"));
}

TEST(JobPlan, AnOrderOfTilesHasEachOnce) {
  const v1::JobSpec submitted = *NormaliseJobSpec(Submitted());
  absl::StatusOr<v1::JobSpec> planned = PlannedSpec(submitted, MadeUpPlan(32, 4, {1, 0}));
  ASSERT_TRUE(planned.ok()) << planned.status();
  for (const std::vector<int32_t>& order :
       {std::vector{1, 1}, std::vector{1}, std::vector{0, 1, 2}, std::vector{-1, 0}, std::vector{1, 2}}) {
    EXPECT_EQ(ErrorOf(MadeUpPlan(32, 4, order)), "plan: tile_order does not have each of the 2 tiles once");
  }
  v1::Plan plan = MadeUpPlan(32, 4, {1, 0});
  Find(plan, "costliest-first")->set_value(0);
  EXPECT_EQ(ErrorOf(plan), "plan: tile_order is set, but costliest-first is off");
  planned->mutable_plan()->set_tile_order(0, 7);
  EXPECT_EQ(NormaliseJobSpec(*planned).status().code(), absl::StatusCode::kInvalidArgument)
      << "a stored spec is checked too";
}

TEST(JobPlan, UnitsAreNumberedInTheOrderOfItsTiles) {
  // 5 x 4 tiles of 8 pixels, the last one first.
  std::vector<int32_t> order(20);
  std::iota(order.rbegin(), order.rend(), 0);
  const absl::StatusOr<v1::JobSpec> planned =
      PlannedSpec(*NormaliseJobSpec(Submitted()), MadeUpPlan(8, 4, order));
  ASSERT_TRUE(planned.ok()) << planned.status();
  const FrameUnits units(*planned);
  ASSERT_EQ(units.count(), 20 * (1 + 4));
  for (int64_t number = 0; number < units.count(); ++number) {
    const UnitKey key = units.KeyOf(0, number);
    const bool is_first = number < 2 * 20;  // geometry and first pass: for those who look at the middle
    EXPECT_EQ(key.tile, is_first ? units.tiles().TileOfRank(static_cast<int>(number / 2))
                                 : order[static_cast<size_t>(number % 20)]);
    EXPECT_EQ(key.pass, is_first ? 0 : number / 20 - 1);
    EXPECT_EQ(units.NumberOf(key), number);
  }
}

TEST(JobPlan, AFullPlanNeedsNoUnit) {
  v1::JobSpec submitted = Forcing("levels=2");
  submitted.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  const absl::StatusOr<v1::JobSpec> spec = NormaliseJobSpec(submitted);
  ASSERT_TRUE(spec.ok()) << spec.status();
  EXPECT_FALSE(NeedsPlan(*spec));
  EXPECT_EQ(spec->tile_size(), kDefaultTileSize);
  for (const v1::PlanDecision& decision : spec->plan().decisions()) {
    const bool is_forced = decision.name() == "levels";
    EXPECT_EQ(decision.source(), is_forced ? v1::DECISION_SOURCE_FORCED : v1::DECISION_SOURCE_FULL);
  }
  EXPECT_EQ(ValueOf(*spec, "levels"), 2);
  EXPECT_EQ(ValueOf(*spec, "bounces"), 4);
  EXPECT_EQ(ValueOf(*spec, "tile-size"), kDefaultTileSize);
  EXPECT_EQ(NormaliseJobSpec(*spec)->SerializeAsString(), spec->SerializeAsString());
  submitted.mutable_planning()->add_forced("costliest-first=on");
  EXPECT_THAT(NormaliseJobSpec(submitted)->plan().decisions().rbegin()->reason(), HasSubstr("no effect"));
}

TEST(JobPlan, ForcedUnitsAreFieldsOfTheSpec) {
  EXPECT_EQ(NormaliseJobSpec(Forcing("tile-size=64"))->tile_size(), 64);
  EXPECT_EQ(NormaliseJobSpec(Forcing("pass-samples=6"))->pass_samples(), 6);
  EXPECT_EQ(NormaliseJobSpec(Forcing("pass-samples=0"))->pass_samples(), kMinDefaultPassSamples);
  v1::JobSpec both = Forcing("tile-size=64");
  both.set_tile_size(32);
  EXPECT_EQ(NormaliseJobSpec(both).status().message(),
            "tile_size is 32, but planning.forced has tile-size=64");
}

TEST(JobPlan, WhatCannotBeForcedIsRefused) {
  const auto error_of = [](const v1::JobSpec& spec) {
    return std::string(NormaliseJobSpec(spec).status().message());
  };
  EXPECT_THAT(error_of(Forcing("speed=9")), HasSubstr("planning.forced: 'speed=9' is not NAME=VALUE"));
  EXPECT_EQ(error_of(Forcing("levels=9")),
            "planning.forced: 'levels=9': levels is a whole number from 0 to 3");
  EXPECT_THAT(error_of(Forcing("pass-samples=7")), HasSubstr("not even"));
  EXPECT_THAT(error_of(Forcing(std::string(kMaxForcedBytes + 1, 'x'))), HasSubstr("planning.forced has"));
  v1::JobSpec many = Submitted();
  for (int i = 0; i <= kMaxForced; ++i) many.mutable_planning()->add_forced("levels=1");
  EXPECT_THAT(error_of(many), HasSubstr("the number of planning.forced is 33"));
  v1::JobSpec unknown = Submitted();
  unknown.mutable_planning()->set_mode(static_cast<v1::PlanMode>(7));
  EXPECT_EQ(error_of(unknown), "planning.mode is 7, not 0 or 1");
}

}  // namespace
}  // namespace lumifold::job
