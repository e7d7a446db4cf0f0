#include "proto/retry/pauses.h"

#include <gtest/gtest.h>

#include <limits>

namespace lumifold::retry {
namespace {

constexpr int kManyFailures = std::numeric_limits<int>::max();

TEST(Pauses, GrowByTheFactorUpToTheLongest) {
  const Pauses pauses = {.first = absl::Milliseconds(250), .longest = absl::Seconds(5), .factor = 4};
  const absl::Duration expected[] = {absl::Milliseconds(250), absl::Seconds(1), absl::Seconds(4),
                                     absl::Seconds(5), absl::Seconds(5)};
  int failures = 0;
  for (const absl::Duration pause : expected) EXPECT_EQ(pauses.After(++failures), pause) << failures;
}

TEST(Pauses, DoubleWhereNothingElseIsSaid) {
  const Pauses pauses = {.first = absl::Seconds(10), .longest = absl::Minutes(10)};
  EXPECT_EQ(pauses.After(1), absl::Seconds(10));
  EXPECT_EQ(pauses.After(2), absl::Seconds(20));
  EXPECT_EQ(pauses.After(6), absl::Seconds(320));
  EXPECT_EQ(pauses.After(7), absl::Minutes(10));
}

TEST(Pauses, AreNeverLongerThanTheLongestHoweverLongTheOutage) {
  const Pauses pauses = {.first = absl::Milliseconds(200), .longest = absl::Seconds(5)};
  for (int failures = 1; failures < 10'000; ++failures) EXPECT_LE(pauses.After(failures), absl::Seconds(5));
  EXPECT_EQ(pauses.After(kManyFailures), absl::Seconds(5));
}

TEST(Pauses, TheLongestAlsoLimitsTheFirst) {
  const Pauses pauses = {.first = absl::Seconds(5), .longest = absl::Milliseconds(10)};
  EXPECT_EQ(pauses.After(1), absl::Milliseconds(10));
}

TEST(Pauses, WithoutALongestAreInfiniteInTheEndAndZeroStaysZero) {
  EXPECT_EQ((Pauses{.first = absl::Seconds(5), .factor = 4}).After(kManyFailures), absl::InfiniteDuration());
  EXPECT_EQ((Pauses{.first = absl::ZeroDuration()}).After(kManyFailures), absl::ZeroDuration());
}

}  // namespace
}  // namespace lumifold::retry
