#include "server/job/ids.h"

#include <gtest/gtest.h>

#include <set>

namespace lumifold::job {
namespace {

TEST(JobId, SortsByTime) {
  const absl::Time time = absl::FromUnixMillis(1'700'000'000'000);
  const auto early = MakeJobId(time, ~uint64_t{0});
  const auto late = MakeJobId(time + absl::Milliseconds(1), 0);
  EXPECT_LT(early, late);
  EXPECT_EQ(early.value().size(), 18u);
  EXPECT_EQ(early.value().substr(0, 2), "j-");
}

TEST(JobId, SameTimeAndRandomGiveTheSameId) {
  const absl::Time time = absl::FromUnixMillis(1'700'000'000'000);
  EXPECT_EQ(MakeJobId(time, 5), MakeJobId(time, 5));
  std::set<JobId> ids;
  for (uint64_t random = 0; random < 1000; ++random) EXPECT_TRUE(ids.insert(MakeJobId(time, random)).second);
}

TEST(JobId, Holds35BitsOfTheRandomNumber) {
  const absl::Time time = absl::FromUnixMillis(1'700'000'000'000);
  std::set<JobId> ids = {MakeJobId(time, 0)};
  for (int bit = 0; bit < 35; ++bit)
    EXPECT_TRUE(ids.insert(MakeJobId(time, uint64_t{1} << bit)).second) << bit;
}

TEST(WorkerId, HasOneText) {
  EXPECT_EQ(TextOf(WorkerId(7)), "w-7");
  EXPECT_EQ(ParseWorkerId("w-7"), WorkerId(7));
  for (const char* text :
       {"", "7", "w-", "w-07", "w-+7", "w- 7", "w-7 ", "W-7", "w-7x", "w-99999999999999999999"})
    EXPECT_EQ(ParseWorkerId(text), std::nullopt) << text;
}

}  // namespace
}  // namespace lumifold::job
