#include "server/scheduler/accepted_units.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/scheduler/unit_names.h"

namespace lumifold::scheduler {
namespace {

using job::WorkerId;
using ::testing::ElementsAre;

TEST(AcceptedUnitsTest, SlotsAreFreeAtOnceUntilTooManyBytesWait) {
  AcceptedUnits accepted(100);
  EXPECT_TRUE(accepted.Add(kFirst, WorkerId(1), 60));
  EXPECT_TRUE(accepted.Add(kSecond, WorkerId(1), 40));
  EXPECT_FALSE(accepted.Add(kOfOther, WorkerId(2), 1));
  EXPECT_TRUE(accepted.Has(kOfOther));
  EXPECT_THAT(accepted.OfJob(7), ElementsAre(kFirst, kSecond));
  EXPECT_EQ(accepted.Remove(kSecond), std::nullopt) << "its slot was free";
  EXPECT_EQ(accepted.Remove(kOfOther), WorkerId(2));
  EXPECT_FALSE(accepted.Has(kOfOther));
  EXPECT_TRUE(accepted.Add(kOfOther, WorkerId(2), 40)) << "60 wait";
}

}  // namespace
}  // namespace lumifold::scheduler
