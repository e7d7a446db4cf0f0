#include "server/coordinator/finish_leases.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>

namespace lumifold::server {
namespace {

using job::Attempt;
using job::JobId;
using job::WorkerId;
using testing::ElementsAre;
using testing::IsEmpty;

const absl::Time kGranted = absl::FromUnixSeconds(1000);
constexpr absl::Duration kLeaseTime = absl::Seconds(30);
/// 42 s of filter on a slow machine.
constexpr int64_t kPixels = 1'000'000;
constexpr char kOneClass[] = "class-1";

class FinishLeasesTest : public testing::Test {
 protected:
  FinishLeasesTest() {
    leases_.AddWorker(kFirst,
                      {.party = "first", .numeric_class = kOneClass, .places = 2, .memory_bytes = 250});
    leases_.AddWorker(kSecond,
                      {.party = "second", .numeric_class = kOneClass, .places = 1, .memory_bytes = 1000});
    leases_.AddWorker(kNone, {.numeric_class = kOneClass, .places = 0, .memory_bytes = 1000});
  }

  std::optional<WorkerId> Place(uint64_t bytes, const std::string& numeric_class = kOneClass) {
    return leases_.FindPlace(numeric_class, bytes, [](WorkerId) { return true; });
  }
  void Grant(int64_t attempt, WorkerId worker, int32_t frame) {
    leases_.Grant(Attempt(attempt),
                  {.part = {{JobId("j-1"), frame}}, .worker = worker, .memory_bytes = 100, .pixels = kPixels},
                  kGranted);
  }
  std::vector<Attempt> Hear(WorkerId worker, const std::vector<scheduler::HeldLease>& held, int64_t newest,
                            absl::Duration later) {
    return leases_.Heartbeat(worker, held, Attempt(newest), kGranted + later);
  }
  std::vector<Attempt> Expired(absl::Time now) {
    return leases_.Expired(now, [this](WorkerId worker) { return worker == blocked_; });
  }
  static scheduler::HeldLease Held(int64_t attempt, int64_t progress) {
    return {.unit = {}, .attempt = Attempt(attempt), .progress = progress};
  }

  static inline const WorkerId kFirst{1};
  static inline const WorkerId kSecond{2};
  static inline const WorkerId kNone{3};
  FinishLeases leases_{kLeaseTime};
  WorkerId blocked_{};
};

TEST_F(FinishLeasesTest, TheWorkerWithMostPlacesThatHoldsTheFrameGetsIt) {
  EXPECT_EQ(Place(100), kFirst);
  EXPECT_EQ(Place(251), kSecond) << "it has the memory";
  EXPECT_EQ(Place(1001), std::nullopt);
  EXPECT_EQ(Place(100, "class-2"), std::nullopt);
  EXPECT_EQ(leases_.FindPlace(kOneClass, 100, [](WorkerId worker) { return worker == kSecond; }), kSecond)
      << "the other one leaves";
  Grant(7, kFirst, 1);
  Grant(8, kFirst, 2);
  EXPECT_EQ(Place(100), kSecond) << "no place is left";
  Grant(9, kSecond, 3);
  EXPECT_EQ(Place(100), std::nullopt);
  EXPECT_EQ(leases_.End(Attempt(7)).part, FramePart(FrameKey(JobId("j-1"), 1)));
  EXPECT_EQ(Place(100), kFirst);
  EXPECT_EQ(Place(151), std::nullopt) << "the other frame takes memory";
}

TEST_F(FinishLeasesTest, ALeaseIsOfItsWorkerAndFrame) {
  Grant(7, kFirst, 1);
  EXPECT_NE(leases_.Find(kFirst, {{JobId("j-1"), 1}}, Attempt(7)), nullptr);
  EXPECT_EQ(leases_.Find(kSecond, {{JobId("j-1"), 1}}, Attempt(7)), nullptr);
  EXPECT_EQ(leases_.Find(kFirst, {{JobId("j-1"), 2}}, Attempt(7)), nullptr);
  EXPECT_EQ(leases_.Find(kFirst, {{JobId("j-1"), 1}}, Attempt(8)), nullptr);
  EXPECT_THAT(leases_.OfJob(JobId("j-1")), ElementsAre(Attempt(7)));
  EXPECT_THAT(leases_.OfJob(JobId("j-2")), IsEmpty());
}

TEST_F(FinishLeasesTest, EndsWithTheConnection) {
  Grant(7, kFirst, 1);
  Grant(8, kSecond, 2);
  EXPECT_THAT(leases_.RemoveWorker(kFirst), ElementsAre(Attempt(7)));
  leases_.End(Attempt(7));
  EXPECT_EQ(Place(100), std::nullopt) << "its places are gone";
  EXPECT_EQ(leases_.size(), 1);
}

TEST_F(FinishLeasesTest, EndsWithoutHeartbeats) {
  Grant(7, kFirst, 1);
  EXPECT_THAT(Expired(kGranted + kLeaseTime - absl::Seconds(1)), IsEmpty());
  EXPECT_THAT(Expired(kGranted + kLeaseTime), ElementsAre(Attempt(7)));
  EXPECT_THAT(Hear(kFirst, {Held(7, 1)}, 7, absl::Seconds(20)), IsEmpty());
  EXPECT_THAT(Expired(kGranted + kLeaseTime), IsEmpty());
}

TEST_F(FinishLeasesTest, EndsWhenTheWorkerNamesItNoMore) {
  Grant(7, kFirst, 1);
  EXPECT_THAT(Hear(kFirst, {}, 6, absl::Seconds(1)), IsEmpty()) << "it is still on its way";
  EXPECT_THAT(Hear(kSecond, {}, 9, absl::Seconds(1)), IsEmpty()) << "another worker";
  EXPECT_THAT(Hear(kFirst, {}, 7, absl::Seconds(1)), ElementsAre(Attempt(7)));
}

TEST_F(FinishLeasesTest, EndsWithoutProgressAndInAnyCaseAfterHalfAnHour) {
  Grant(7, kFirst, 1);
  Grant(8, kSecond, 2);
  for (absl::Duration later; later < absl::Minutes(30); later += absl::Seconds(6)) {
    EXPECT_THAT(Expired(kGranted + later),
                later < absl::Seconds(72) ? testing::Matcher<std::vector<Attempt>>(IsEmpty())
                                          : testing::Matcher<std::vector<Attempt>>(ElementsAre(Attempt(7))))
        << later;
    Hear(kFirst, {Held(7, 0)}, 8, later);
    Hear(kSecond, {Held(8, later / absl::Seconds(60))}, 8, later);
  }
  EXPECT_THAT(Expired(kGranted + absl::Minutes(30)), ElementsAre(Attempt(7), Attempt(8)));
}

TEST_F(FinishLeasesTest, AnOfferCountsWhileItsPlacesAreTaken) {
  const auto offers = [&](uint64_t bytes, const std::string& numeric_class = kOneClass) {
    return leases_.HasOffer(numeric_class, bytes, [](WorkerId worker) { return worker == kSecond; });
  };
  Grant(7, kSecond, 1);
  EXPECT_TRUE(offers(1000));
  EXPECT_FALSE(offers(1001));
  EXPECT_FALSE(offers(100, "class-2"));
  leases_.RemoveWorker(kSecond);
  EXPECT_FALSE(offers(100)) << "the first one is not available";
}

TEST_F(FinishLeasesTest, EndsWhenTheWorkerIsBlocked) {
  Grant(7, kFirst, 1);
  Grant(8, kSecond, 2);
  blocked_ = kSecond;
  EXPECT_THAT(Expired(kGranted), ElementsAre(Attempt(8)));
}

TEST_F(FinishLeasesTest, DoesNotEndWhileItsResultIsRecorded) {
  Grant(7, kFirst, 1);
  leases_.Find(kFirst, {{JobId("j-1"), 1}}, Attempt(7))->is_delivered = true;
  EXPECT_THAT(Expired(kGranted + absl::Hours(1)), IsEmpty());
  EXPECT_THAT(Hear(kFirst, {}, 7, absl::Seconds(1)), IsEmpty());
  EXPECT_THAT(leases_.RemoveWorker(kFirst), IsEmpty());
  EXPECT_TRUE(leases_.IsDelivered(Attempt(7)));
}

TEST_F(FinishLeasesTest, APartyThatFailsAFrameGetsNoneOfThatJobForAWhile) {
  const JobId job("j-1");
  Grant(1, kFirst, 0);
  leases_.Exclude(leases_.End(Attempt(1)).party, job, kGranted);
  EXPECT_TRUE(leases_.IsExcluded(kFirst, job, kGranted));
  EXPECT_FALSE(leases_.IsExcluded(kFirst, JobId("j-2"), kGranted));
  leases_.RemoveWorker(kFirst);
  const WorkerId again(9);
  leases_.AddWorker(again, {.party = "first", .numeric_class = kOneClass, .places = 2, .memory_bytes = 250});
  EXPECT_TRUE(leases_.IsExcluded(again, job, kGranted)) << "its next process is the same party";
  leases_.Exclude("second", job, kGranted);
  EXPECT_FALSE(leases_.IsExcluded(kSecond, job, kGranted)) << "half of them are";
  EXPECT_FALSE(leases_.IsExcluded(again, job, kGranted + absl::Minutes(5)));
  leases_.Exclude("second", job, kGranted + absl::Minutes(5));
  EXPECT_TRUE(leases_.IsExcluded(kSecond, job, kGranted + absl::Minutes(5)));
}

}  // namespace
}  // namespace lumifold::server
