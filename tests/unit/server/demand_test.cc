#include "server/coordinator/demand.h"

#include <gtest/gtest.h>

namespace lumifold::server {
namespace {

scheduler::JobProgress Progress(int64_t done, int64_t total, int64_t leases) {
  scheduler::JobProgress progress;
  progress.state = v1::JOB_STATE_RUNNING;
  progress.units_done = done;
  progress.units_total = total;
  progress.leases = leases;
  return progress;
}

v1::Scheduling Of(const std::string& user, const std::vector<std::string>& tags = {}, int max_leases = 0) {
  v1::Scheduling scheduling;
  scheduling.set_user(user);
  *scheduling.mutable_tags() = {tags.begin(), tags.end()};
  scheduling.set_max_leases(max_leases);
  return scheduling;
}

TEST(DemandSum, SumsUpByUserAndTagsAndNamesNobody) {
  DemandSum sum;
  sum.Add(Of("ann"), Progress(2, 10, 3));
  sum.Add(Of("ann", {"night", "gpu"}), Progress(0, 4, 0));
  sum.Add(Of("ann", {"gpu", "night"}), Progress(0, 6, 0));
  sum.Add(Of("ben"), Progress(0, 1, 1));
  v1::ServerStatus status;
  sum.AddTo(&status);
  ASSERT_EQ(status.demand_size(), 3);
  EXPECT_EQ(status.demand(0).ShortDebugString(), "units_queued: 5 units_leased: 3");
  EXPECT_EQ(status.demand(1).ShortDebugString(), "tags: \"gpu\" tags: \"night\" units_queued: 10");
  EXPECT_EQ(status.demand(2).ShortDebugString(), "user: 1 units_leased: 1");
}

TEST(DemandSum, LeavesOutWhatCannotBeLeased) {
  DemandSum sum;
  scheduler::JobProgress paused = Progress(0, 10, 0);
  paused.state = v1::JOB_STATE_PAUSED;
  sum.Add(Of("ann"), paused);
  sum.Add(Of("ben", {}, 4), Progress(0, 10, 3));
  sum.Add(Of("cat"), Progress(10, 10, 0));
  sum.Add(Of("dan"), Progress(9, 10, 2));  // its last unit is leased twice
  v1::ServerStatus status;
  sum.AddTo(&status);
  ASSERT_EQ(status.demand_size(), 2);
  EXPECT_EQ(status.demand(0).ShortDebugString(), "units_queued: 1 units_leased: 3");
  EXPECT_EQ(status.demand(1).ShortDebugString(), "user: 1 units_leased: 2");
}

}  // namespace
}  // namespace lumifold::server
