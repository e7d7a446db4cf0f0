#include "server/access/rate_limit.h"

#include <gtest/gtest.h>

#include <string>

namespace lumifold::access {
namespace {

TEST(TokenBuckets, ABurstAndThenTheRate) {
  TokenBuckets buckets(10, 5);
  absl::Time now = absl::UnixEpoch();
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(buckets.Take("ann", now));
  EXPECT_FALSE(buckets.Take("ann", now));
  now += absl::Milliseconds(100);
  EXPECT_TRUE(buckets.Take("ann", now));
  EXPECT_FALSE(buckets.Take("ann", now));
  now += absl::Hours(1);
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(buckets.Take("ann", now));
  EXPECT_FALSE(buckets.Take("ann", now));
}

TEST(TokenBuckets, CallersDoNotTakeFromEachOther) {
  TokenBuckets buckets(1, 1);
  const absl::Time now = absl::UnixEpoch();
  EXPECT_TRUE(buckets.Take("ann", now));
  EXPECT_FALSE(buckets.Take("ann", now));
  EXPECT_TRUE(buckets.Take("bob", now));
}

TEST(TokenBuckets, TimeThatStandsStillOrGoesBackGivesNothing) {
  TokenBuckets buckets(1000, 1);
  const absl::Time now = absl::UnixEpoch();
  EXPECT_TRUE(buckets.Take("ann", now));
  EXPECT_FALSE(buckets.Take("ann", now - absl::Hours(1)));
  EXPECT_FALSE(buckets.Take("ann", now));
}

TEST(TokenBuckets, CallersThatPausedTakeNoMemory) {
  TokenBuckets buckets(10, 5);
  absl::Time now = absl::UnixEpoch();
  for (int i = 0; i < 100'000; ++i) {
    buckets.Take(std::to_string(i), now);
    now += absl::Milliseconds(10);
  }
  EXPECT_LT(buckets.size(), 200u);
}

TEST(CallerCounts, AreBoundedForEachCaller) {
  CallerCounts counts;
  EXPECT_TRUE(counts.Add("ann", 2));
  EXPECT_TRUE(counts.Add("ann", 2));
  EXPECT_FALSE(counts.Add("ann", 2));
  EXPECT_TRUE(counts.Add("bob", 2));
  counts.Remove("ann");
  EXPECT_TRUE(counts.Add("ann", 2));
  EXPECT_FALSE(counts.Add("cy", 0));
}

}  // namespace
}  // namespace lumifold::access
