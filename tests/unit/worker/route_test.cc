#include "worker/connection/route.h"

#include <gtest/gtest.h>

namespace lumifold::worker {
namespace {

constexpr bool kSteady = true;

Route Of(std::vector<std::string> endpoints) {
  return {std::move(endpoints), [] { return 0.0; }};
}

TEST(Route, PausesOnceAllHaveBeenTried) {
  Route route = Of({"a:1", "b:1", "c:1"});
  EXPECT_FALSE(route.IsOnly());
  for (const absl::Duration pause : {rpc::kReconnectPauses.first, 2 * rpc::kReconnectPauses.first}) {
    EXPECT_EQ(route.current(), "a:1");
    EXPECT_EQ(route.Leave(!kSteady), absl::ZeroDuration());
    EXPECT_EQ(route.current(), "b:1");
    EXPECT_EQ(route.Leave(!kSteady), absl::ZeroDuration());
    EXPECT_EQ(route.current(), "c:1");
    EXPECT_EQ(route.Leave(!kSteady), pause);
  }
}

TEST(Route, GoesOnAtOnceFromOneThatWasSteady) {
  Route route = Of({"a:1", "b:1"});
  for (int i = 0; i < 4; ++i) route.Leave(!kSteady);
  EXPECT_EQ(route.Leave(kSteady), absl::ZeroDuration());
  EXPECT_EQ(route.current(), "b:1");
  EXPECT_EQ(route.Leave(!kSteady), rpc::kReconnectPauses.first) << "the schedule has begun again";
}

TEST(Route, TheOnlyOneIsTriedAfterEachPause) {
  Route route = Of({"a:1"});
  EXPECT_TRUE(route.IsOnly());
  EXPECT_EQ(route.Leave(!kSteady), rpc::kReconnectPauses.first);
  EXPECT_EQ(route.Leave(!kSteady), 2 * rpc::kReconnectPauses.first);
  EXPECT_EQ(route.Leave(kSteady), rpc::kReconnectPauses.first);
  EXPECT_EQ(route.current(), "a:1");
}

TEST(Route, GoesWhereItIsSentAndBackToTheListFromThere) {
  Route route = Of({"a:1", "b:1"});
  route.MoveTo("x:1");
  EXPECT_EQ(route.current(), "x:1");
  EXPECT_FALSE(route.IsOnly());
  EXPECT_EQ(route.Leave(kSteady), absl::ZeroDuration());
  EXPECT_EQ(route.current(), "a:1");
  route.MoveTo("b:1");
  EXPECT_EQ(route.current(), "b:1");
  EXPECT_EQ(route.Leave(!kSteady), absl::ZeroDuration());
  EXPECT_EQ(route.current(), "a:1");
}

TEST(Route, PausesWhenItIsSentToNowhereAgainAndAgain) {
  Route route = Of({"a:1"});
  for (int i = 0; i < 3; ++i) {
    route.MoveTo("x:1");
    EXPECT_FALSE(route.IsOnly());
    EXPECT_EQ(route.Leave(!kSteady), (1 << i) * rpc::kReconnectPauses.first);
  }
}

}  // namespace
}  // namespace lumifold::worker
