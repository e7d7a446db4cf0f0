#include "server/scheduler/accepted_units.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::scheduler {
namespace {

using job::WorkerId;
using ::testing::ElementsAre;

constexpr UnitIndex kFirst{1, {0, 0}};
constexpr UnitIndex kSecond{1, {0, 1}};
constexpr UnitIndex kThird{2, {0, 0}};

TEST(AcceptedUnitsTest, SlotsAreFreeAtOnceUntilTooManyBytesWait) {
  AcceptedUnits accepted(100);
  EXPECT_TRUE(accepted.Add(kFirst, WorkerId(1), 60));
  EXPECT_TRUE(accepted.Add(kSecond, WorkerId(1), 40));
  EXPECT_FALSE(accepted.Add(kThird, WorkerId(2), 1));
  EXPECT_TRUE(accepted.Has(kThird));
  EXPECT_THAT(accepted.OfJob(1), ElementsAre(kFirst, kSecond));
  EXPECT_EQ(accepted.Remove(kSecond), std::nullopt) << "its slot was free";
  EXPECT_EQ(accepted.Remove(kThird), WorkerId(2));
  EXPECT_FALSE(accepted.Has(kThird));
  EXPECT_TRUE(accepted.Add(kThird, WorkerId(2), 40)) << "60 wait";
}

}  // namespace
}  // namespace lumifold::scheduler
