#include "server/cluster/balance.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace lumifold::cluster {
namespace {

using ledger::Epoch;
using ledger::Member;

constexpr int kSlotsOfWorker = 2;

Member Of(int64_t epoch, int64_t workers, int64_t demand) {
  return {.owner = {"", Epoch(epoch)},
          .address = std::to_string(epoch),
          .workers = workers,
          .slots = workers * kSlotsOfWorker,
          .demand = demand};
}

/// Slots of each job where all are given out and nobody gets more than it demands, by bisection.
double FairSlotsPerJob(const std::vector<Member>& members) {
  double low = 0;
  double high = 1e6;
  for (int i = 0; i < 100; ++i) {
    const double middle = (low + high) / 2;
    double left = 0;
    for (const Member& member : members)
      left += static_cast<double>(member.slots) -
              std::min(static_cast<double>(member.demand), middle * static_cast<double>(member.active_jobs));
    (left > 0 ? low : high) = middle;
  }
  return low;
}

/// Lets each member decide in turn until nobody moves anything; the workers of each then.
std::vector<int64_t> Settle(std::vector<Member> members) {
  bool moved = true;
  for (int round = 0; moved && round < 20; ++round) {
    moved = false;
    for (Member& giver : members) {
      const std::optional<WorkerMove> move = FindMove(members, giver.owner.epoch);
      if (!move.has_value()) continue;
      moved = true;
      for (Member& taker : members) {
        const int64_t change =
            &taker == &giver ? -move->workers : (taker.address == move->address ? move->workers : 0);
        taker.workers += change;
        taker.slots += change * kSlotsOfWorker;
      }
    }
  }
  EXPECT_FALSE(moved) << "workers wander";
  std::vector<int64_t> workers;
  for (const Member& member : members) workers.push_back(member.workers);
  return workers;
}

TEST(BalanceTest, AllWorkersGoToTheOnlyJob) {
  EXPECT_EQ(FindMove({{Of(1, 2, 0), Of(2, 2, 100)}}, Epoch(1)), (WorkerMove{2, "2"}));
  EXPECT_EQ(Settle({Of(1, 2, 0), Of(2, 2, 100), Of(3, 4, 0)}), (std::vector<int64_t>{0, 8, 0}));
}

TEST(BalanceTest, NobodyMovesWithoutDemandOrWhereAllGetWhatTheyDemand) {
  EXPECT_EQ(FindMove({{Of(1, 5, 0), Of(2, 0, 0)}}, Epoch(1)), std::nullopt);
  EXPECT_EQ(FindMove({{Of(1, 5, 3), Of(2, 1, 2)}}, Epoch(1)), std::nullopt);
  EXPECT_EQ(FindMove({{Of(1, 5, 3)}}, Epoch(1)), std::nullopt);
  EXPECT_EQ(FindMove({{Of(1, 5, 3)}}, Epoch(7)), std::nullopt);
}

TEST(BalanceTest, JobsGetEqualSlotsAsFarAsTheyDemandThem) {
  EXPECT_EQ(Settle({Of(1, 9, 100), Of(2, 0, 100), Of(3, 0, 100)}), (std::vector<int64_t>{3, 3, 3}));
  EXPECT_EQ(Settle({Of(1, 0, 300), Of(2, 8, 100)}), (std::vector<int64_t>{4, 4}));
  // A preview does not wait for the end of a film.
  EXPECT_EQ(Settle({Of(1, 10, 1000), Of(2, 0, 2)}), (std::vector<int64_t>{9, 1}));
  std::vector<Member> members = {Of(1, 8, 1000), Of(2, 0, 1000)};
  members[1].active_jobs = 3;
  EXPECT_EQ(Settle(members), (std::vector<int64_t>{2, 6}));
}

TEST(BalanceTest, AShareOfLessThanAWorkerIsAWorker) {
  EXPECT_EQ(Settle({Of(1, 4, 100), Of(2, 0, 1)}), (std::vector<int64_t>{3, 1}));
  EXPECT_EQ(Settle({Of(1, 3, 100), Of(2, 0, 1), Of(3, 0, 1)}), (std::vector<int64_t>{1, 1, 1}));
  EXPECT_EQ(Settle({Of(1, 1, 100), Of(2, 0, 1)}), (std::vector<int64_t>{1, 0}));  // it would only wander
}

TEST(BalanceTest, MovesEndForAnyFarmAndLeaveNobodyShortOfItsShare) {
  uint64_t state = 1;
  const auto below = [&state](uint64_t n) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<int64_t>((state >> 33) % n);
  };
  for (int i = 0; i < 1000; ++i) {
    std::vector<Member> members;
    int64_t workers = 0;
    for (int64_t epoch = 0; epoch < 2 + below(4); ++epoch) {
      members.push_back(Of(epoch, below(10), below(3) == 0 ? 0 : below(below(2) == 0 ? 8 : 200)));
      members.back().active_jobs = 1 + below(4);
      workers += members.back().workers;
    }
    const double per_job = FairSlotsPerJob(members);
    const std::vector<int64_t> settled = Settle(members);
    int64_t left = 0;
    for (size_t k = 0; k < members.size(); ++k) {
      left += settled[k];
      const double share = std::min(static_cast<double>(members[k].demand),
                                    per_job * static_cast<double>(members[k].active_jobs));
      EXPECT_GT(static_cast<double>(settled[k] * kSlotsOfWorker), share - 3 * kSlotsOfWorker) << i;
    }
    EXPECT_EQ(left, workers);
  }
}

}  // namespace
}  // namespace lumifold::cluster
