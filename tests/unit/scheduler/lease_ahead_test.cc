#include "server/scheduler/lease_ahead.h"

#include <gtest/gtest.h>

namespace lumifold::scheduler {
namespace {

constexpr int kSlotsOfTwo = 4;  // threads

TEST(LeaseAheadTest, NothingIsAheadOfANearWorker) {
  LeaseAhead ahead;
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 0) << "nothing is known";
  ahead.AddUnit(absl::Milliseconds(50), 1000);
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 0);
  ahead.AddRoundTrip(absl::Milliseconds(50));
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 0) << "while the unit that waits is rendered, the next one comes";
}

TEST(LeaseAheadTest, WhatTheThreadsRenderInARoundTripIsAhead) {
  LeaseAhead ahead;
  ahead.AddRoundTrip(absl::Milliseconds(600));
  ahead.AddUnit(absl::Milliseconds(50), 1000);
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 22);
  EXPECT_EQ(ahead.Leases(1), 11) << "one thread";
}

TEST(LeaseAheadTest, TheShortestRoundTripsCountMost) {
  LeaseAhead ahead;
  ahead.AddUnit(absl::Milliseconds(50), 1000);
  ahead.AddRoundTrip(absl::Seconds(60));
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 2 * 39) << "at most two seconds";
  ahead.AddRoundTrip(absl::Milliseconds(100));
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 2);
  ahead.AddRoundTrip(absl::Milliseconds(500));
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 4) << "an eighth of the difference";
}

TEST(LeaseAheadTest, TheBytesThatWaitForTheNetworkAreBounded) {
  LeaseAhead ahead;
  ahead.AddRoundTrip(absl::Seconds(2));
  ahead.AddUnit(absl::Milliseconds(1), 16 << 20);
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 4);
  for (int i = 0; i < 100; ++i) ahead.AddUnit(absl::Milliseconds(1), 100);
  EXPECT_EQ(ahead.Leases(kSlotsOfTwo), 256);
}

}  // namespace
}  // namespace lumifold::scheduler
