// What the stores of all databases do with messages for webhooks.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "server/ledger/delivery_queue.h"
#include "tests/unit/ledger/job_store_fixture.h"

namespace lumifold::ledger {
namespace {

using job::JobId;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr char kOrigin[] = "https://a.example:443";

std::vector<DatabaseKind> KindsWithDeliveries() {
  std::vector<DatabaseKind> kinds = DatabaseKinds();
  std::erase_if(kinds, [](const DatabaseKind& kind) { return kind.name == "Model"; });
  return kinds;
}

class DeliveriesTest : public JobStoreTest {
 protected:
  /// A job that has ended with a message.
  void EndJob(const std::string& id, const std::string& origin = kOrigin, absl::Time created = kStart) {
    ASSERT_TRUE(store_->CreateJob(Job(id, id)).ok());
    const NewDelivery delivery = {.id = "d-" + id,
                                  .origin = origin,
                                  .url = origin + "/hook",
                                  .body = std::string("{\0}", 3) + id,
                                  .created = created};
    for (int i = 0; i < 2; ++i)  // the second time nothing is recorded: the job has ended
      ASSERT_TRUE(store_->EndJob(Owned(id), {v1::JOB_STATE_DONE, "", delivery}).ok());
  }

  std::vector<std::string> Take(absl::Time now, int max = 10, const std::string& origin = kOrigin) {
    const auto taken = store_->deliveries().Take(origin, now, now + absl::Minutes(1), max);
    EXPECT_TRUE(taken.ok()) << taken.status();
    std::vector<std::string> ids;
    for (const Delivery& delivery : *taken) {
      EXPECT_EQ(delivery.id, "d-" + delivery.job.value());
      EXPECT_EQ(delivery.url, origin + "/hook");
      EXPECT_EQ(delivery.body, std::string("{\0}", 3) + delivery.job.value());
      ids.push_back(delivery.id);
      numbers_[delivery.id] = delivery.number;
    }
    return ids;
  }

  /// An empty one where there is none.
  DeliveryReport Last(const std::string& job) {
    return store_->deliveries().LastOf(JobId(job)).value_or(std::nullopt).value_or(DeliveryReport());
  }

  std::map<std::string, int64_t> numbers_;
};

INSTANTIATE_TEST_SUITE_P(All, DeliveriesTest, ::testing::ValuesIn(KindsWithDeliveries()),
                         [](const auto& kind) { return kind.param.name; });

TEST_P(DeliveriesTest, AMessageIsTheTakersForATime) {
  EndJob("j-a");
  EndJob("j-b");
  EndJob("j-c", "http://other.example:80");
  EXPECT_THAT(Take(kStart - absl::Seconds(1)), IsEmpty());
  EXPECT_THAT(Take(kStart, 1), ElementsAre("d-j-a"));
  EXPECT_THAT(Take(kStart), ElementsAre("d-j-b"));
  EXPECT_THAT(Take(kStart), IsEmpty());
  EXPECT_EQ(*store_->deliveries().CountWaiting(), 3);
  Reopen();
  EXPECT_THAT(Take(kStart + absl::Minutes(1)), ElementsAre("d-j-a", "d-j-b"));
  EXPECT_THAT(Take(kStart, 10, "http://other.example:80"), ElementsAre("d-j-c"));
}

TEST_P(DeliveriesTest, AMessageIsPutOffUntilItIsDelivered) {
  EndJob("j-a");
  EXPECT_THAT(Take(kStart), ElementsAre("d-j-a"));
  DeliveryQueue& queue = store_->deliveries();
  const absl::Time later = kStart + absl::Hours(1);
  ASSERT_TRUE(queue.PutOff(numbers_["d-j-a"], later, "answered with 500").ok());
  EXPECT_THAT(Take(later - absl::Milliseconds(1)), IsEmpty());
  EXPECT_THAT(Take(later), ElementsAre("d-j-a"));
  ASSERT_TRUE(queue.PutOff(numbers_["d-j-a"], later, "").ok());
  DeliveryReport report = Last("j-a");
  EXPECT_EQ(report.state, DeliveryState::kWaiting);
  EXPECT_EQ(report.tries, 2);
  EXPECT_EQ(report.error, "answered with 500");
  ASSERT_TRUE(queue.SetDelivered(numbers_["d-j-a"]).ok());
  report = Last("j-a");
  EXPECT_EQ(report.state, DeliveryState::kDelivered);
  EXPECT_THAT(Take(absl::FromUnixSeconds(4'000'000'000)), IsEmpty());
  EXPECT_EQ(*queue.CountWaiting(), 0);
  EXPECT_EQ(*queue.LastOf(JobId("j-x")), std::nullopt);
}

TEST_P(DeliveriesTest, OldMessagesAreGivenUpOnce) {
  EndJob("j-a");
  EndJob("j-b", kOrigin, kStart + absl::Hours(2));
  EXPECT_THAT(Take(kStart), ElementsAre("d-j-a"));
  DeliveryQueue& queue = store_->deliveries();
  const auto given_up = queue.GiveUp(kStart + absl::Hours(1));
  ASSERT_TRUE(given_up.ok()) << given_up.status();
  ASSERT_EQ(given_up->size(), 1u);
  EXPECT_EQ(given_up->front().job, JobId("j-a"));
  EXPECT_EQ(given_up->front().tries, 1);
  EXPECT_THAT(*queue.GiveUp(kStart + absl::Hours(1)), IsEmpty());
  EXPECT_EQ(Last("j-a").state, DeliveryState::kGivenUp);
  EXPECT_EQ(*queue.CountWaiting(), 1);
}

TEST_P(DeliveriesTest, EachEndOfAJobHasItsMessageAndAllGoWithTheJob) {
  EndJob("j-a");
  ASSERT_TRUE(store_
                  ->ReopenFrames(JobId("j-a"), {"coordinator:1", Epoch(1)},
                                 {.spec = Job("j-a", "j-a").spec, .scheduling = {}, .frames = {}})
                  .ok());
  const NewDelivery second = {
      .id = "d-2", .origin = kOrigin, .url = "u", .body = "b", .created = kStart + absl::Hours(1)};
  ASSERT_TRUE(store_->EndJob(Owned("j-a"), {v1::JOB_STATE_FAILED, "broken", second}).ok());
  EXPECT_EQ(Last("j-a").id, "d-2");
  EXPECT_EQ(*store_->deliveries().CountWaiting(), 2);
  ASSERT_TRUE(store_->DeleteJob(JobId("j-a")).ok());
  EXPECT_EQ(*store_->deliveries().CountWaiting(), 0);
}

}  // namespace
}  // namespace lumifold::ledger
