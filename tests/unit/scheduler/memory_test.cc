// Jobs go to workers that can hold them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/scheduler/memory_needs.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::WorkerId;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

constexpr uint64_t kGiB = uint64_t{1} << 30;
const UnitFailure kOutOfMemory{.out_of_memory = true, .error = "not enough memory for the scene"};

v1::JobSpec Needing(uint64_t bytes) {
  v1::JobSpec spec = Spec();
  spec.mutable_plan()->set_memory_bytes(bytes);
  return spec;
}

class MemoryTest : public SchedulerFixture {
 protected:
  void Add(int64_t id, uint64_t memory_bytes, int slots = 1) {
    scheduler_.workers().Add(WorkerId(id), {.name = absl::StrCat("w", id),
                                            .numeric_class = "avx2",
                                            .slots = slots,
                                            .memory_bytes = memory_bytes});
  }
  std::vector<GrantedLease> Grant(int64_t id) { return scheduler_.GrantLeases(WorkerId(id), now_); }
  void RunOut(int64_t id) {
    const std::vector<GrantedLease> leases = Grant(id);
    ASSERT_THAT(leases, SizeIs(1));
    EXPECT_TRUE(scheduler_.units().Fail(WorkerId(id), leases[0].unit, leases[0].attempt, kOutOfMemory, now_));
  }

  absl::Time now_ = kStart;
};

TEST_F(MemoryTest, AJobGoesToWorkersThatHoldIt) {
  scheduler_.jobs().Add(kJob, Needing(3 * kGiB));
  Add(1, 2 * kGiB);
  Add(2, 4 * kGiB);
  Add(3, 0);  // a worker of an earlier version, which does not say
  EXPECT_THAT(Grant(1), IsEmpty());
  EXPECT_THAT(Grant(2), SizeIs(1));
  EXPECT_THAT(Grant(3), SizeIs(1));
  EXPECT_THAT(scheduler_.Explain(kJob, now_), Not(Contains(Field(&Reason::code, "memory"))));
}

TEST_F(MemoryTest, TheNumbersAreNamedWhereNoneHoldsIt) {
  scheduler_.jobs().Add(kJob, Needing(3 * kGiB + kGiB / 5));
  Add(1, 2 * kGiB);
  Add(2, kGiB);
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty());
  EXPECT_THAT(scheduler_.Explain(kJob, now_),
              ElementsAre(AllOf(Field(&Reason::code, "memory"),
                                Field(&Reason::text,
                                      "the job needs 3.2 GiB of memory; the largest worker of any "
                                      "class has 2.0 GiB"))));
}

TEST_F(MemoryTest, ItIsKnownOnceTheJobIsPlanned) {
  v1::JobSpec spec = Spec();
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_AUTO);
  scheduler_.jobs().Add(kJob, spec);
  Add(1, 2 * kGiB);
  const std::vector<GrantedLease> plan = Grant(1);
  ASSERT_THAT(plan, SizeIs(1));
  scheduler_.units().Complete(WorkerId(1), plan[0].unit, plan[0].attempt, now_);
  v1::JobSpec planned = Needing(3 * kGiB);
  scheduler_.units().SetPlan(plan[0].unit, planned);
  EXPECT_THAT(Grant(1), IsEmpty());
  Add(2, 4 * kGiB);
  EXPECT_THAT(Grant(2), SizeIs(1));
}

TEST_F(MemoryTest, WithoutAPlanTheFilesSayHowMuchItIsAtLeast) {
  v1::JobSpec spec = Spec();
  spec.mutable_scene()->mutable_file()->set_size(kGiB);
  spec.mutable_scene()->add_dependencies()->set_size(2 * kGiB);
  scheduler_.jobs().Add(kJob, spec);
  Add(1, 2 * kGiB);
  Add(2, 4 * kGiB);
  EXPECT_THAT(Grant(1), IsEmpty());
  EXPECT_THAT(Grant(2), SizeIs(1));
}

TEST_F(MemoryTest, OneThatRanOutIsTooSmallForTheJobAndSaysNothingAgainstIt) {
  scheduler_.jobs().Add(kJob, Needing(kGiB));
  scheduler_.jobs().Add(kOther, Needing(kGiB));
  for (const int64_t id : {1, 2}) Add(id, 2 * kGiB);
  const int units = 20;
  RunOut(1);
  for (int i = 0; i < units; ++i) {
    for (const int64_t id : {1, 2}) {
      for (const GrantedLease& lease : Grant(id)) {
        EXPECT_EQ(lease.unit.job, kOther);
        scheduler_.units().HandBack(WorkerId(id), lease.unit, lease.attempt);
      }
    }
  }
  EXPECT_THAT(scheduler_.Explain(kJob, now_),
              Contains(AllOf(Field(&Reason::code, "memory"),
                             Field(&Reason::text,
                                   AllOf(HasSubstr("more than 2.0 GiB of memory: worker w1 ran out of it"),
                                         HasSubstr("tried again in 300 s"))))));
  EXPECT_THAT(scheduler_.TakeFailedJobs(), IsEmpty());
  Add(3, 4 * kGiB);
  const std::vector<GrantedLease> larger = Grant(3);
  ASSERT_THAT(larger, SizeIs(1));
  EXPECT_EQ(larger[0].unit.job, kJob);
}

TEST_F(MemoryTest, ItIsTriedAgainAfterAWhileAndNeverFailsTheJob) {
  scheduler_.jobs().Add(kJob, Needing(kGiB));
  Add(1, 2 * kGiB);
  for (int i = 0; i < 10; ++i) {
    RunOut(1);
    EXPECT_THAT(Grant(1), IsEmpty());
    EXPECT_EQ(scheduler_.NextExpiry(), now_ + absl::Minutes(5));
    now_ += absl::Minutes(5);
    scheduler_.ExpireLeases(now_);
    EXPECT_THAT(scheduler_.TakeFailedJobs(), IsEmpty());
    EXPECT_EQ(scheduler_.workers().CoolDownReason(WorkerId(1)), "");
  }
  EXPECT_THAT(Grant(1), SizeIs(1));
}

TEST_F(MemoryTest, AWorkerWithoutSlotsRendersNothingAndCountsForNothing) {
  scheduler_.jobs().Add(kJob, Spec());
  Add(1, kGiB, /*slots=*/0);
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty());
  EXPECT_THAT(scheduler_.Explain(kJob, now_), Contains(Field(&Reason::code, "no_worker")));
  scheduler_.workers().Remove(WorkerId(1));
  Add(2, kGiB);
  EXPECT_THAT(scheduler_.GrantLeases(now_), SizeIs(1));
}

TEST(MemoryNeeds, TheMostThatWasTooLittleCountsForAWhile) {
  MemoryNeeds needs;
  needs.SetPlanned(1, 100);
  EXPECT_EQ(needs.Of(1).bytes(), 100u);
  needs.RanOut(1, "a", 200, kStart);
  needs.RanOut(1, "b", 150, kStart + absl::Seconds(1));
  EXPECT_EQ(needs.Of(1).bytes(), 201u);
  EXPECT_EQ(needs.Of(1).worker, "a");
  needs.RanOut(1, "c", 300, kStart + absl::Seconds(2));
  EXPECT_EQ(needs.Of(1).bytes(), 301u);
  EXPECT_EQ(needs.NextEnd(), kStart + absl::Seconds(2));
  EXPECT_THAT(needs.TakeEnded(kStart + absl::Seconds(1)), IsEmpty());
  EXPECT_THAT(needs.TakeEnded(kStart + absl::Seconds(2)), ElementsAre(1));
  EXPECT_EQ(needs.Of(1).bytes(), 100u);
  needs.RanOut(1, "a", 200, kStart);
  needs.EndJob(1);
  EXPECT_EQ(needs.NextEnd(), absl::InfiniteFuture());
}

TEST(WorkerPool, MemoryIsRoundedDownByLessThanA32nd) {
  for (const uint64_t bytes : {uint64_t{1}, uint64_t{63}, uint64_t{64}, uint64_t{12345678}, 3 * kGiB - 1}) {
    WorkerPool pool;
    pool.Add(WorkerId(1), {.name = "a", .memory_bytes = bytes});
    const uint64_t counted = pool.LargestMemory({});
    EXPECT_LE(counted, bytes);
    EXPECT_GT(counted, bytes - bytes / 32 - 1);
  }
}

}  // namespace
}  // namespace lumifold::scheduler
