#include "client/reports/plan_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/made_up_plan.h"

namespace lumifold::client {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(PlanReport, TableAndJsonHaveEveryDecision) {
  v1::Plan plan = MadeUpPlan();
  plan.mutable_decisions(6)->set_saving("a lot");
  plan.add_tile_order(1);
  plan.add_tile_order(0);
  const std::string table = PlanTable(plan);
  const nlohmann::json json = nlohmann::json::parse(PlanJson(plan));
  ASSERT_EQ(json["decisions"].size(), decisions::kAll.size());
  for (size_t i = 0; i < decisions::kAll.size(); ++i) {
    EXPECT_THAT(table, HasSubstr("\n" + std::string(decisions::kAll[i].name) + " "));
    EXPECT_EQ(json["decisions"][i]["name"], std::string(decisions::kAll[i].name));
    EXPECT_EQ(json["decisions"][i]["governs"], std::string(decisions::kAll[i].governs));
    EXPECT_EQ(json["decisions"][i]["by"], "probe");
    EXPECT_EQ(json["decisions"][i]["reason"], "made up");
  }
  EXPECT_EQ(json["decisions"][6]["value"], "on");
  EXPECT_EQ(json["decisions"][1]["value"], "3");
  EXPECT_THAT(table, HasSubstr("made up (saves a lot)"));
  EXPECT_THAT(table, HasSubstr("The probe traced 1000 rays"));
  EXPECT_EQ(json["tile_order"], nlohmann::json({1, 0}));
  EXPECT_EQ(json["probe_rays"], 1000);
  plan.set_probe_rays(0);
  EXPECT_THAT(PlanTable(plan), Not(HasSubstr("probe traced"))) << "a full plan has no probe";
}

}  // namespace
}  // namespace lumifold::client
