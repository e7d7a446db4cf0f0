#include "server/cluster/membership.h"

#include <gtest/gtest.h>
#include <spdlog/logger.h>

#include <string>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "proto/threads/event.h"

namespace lumifold::cluster {
namespace {

using ledger::Epoch;
using ledger::Member;

constexpr absl::Duration kLease = absl::Milliseconds(60);

/// A roster of two members whose database may stop answering.
class FakeRoster final : public ledger::Roster {
 public:
  explicit FakeRoster(bool knows_another) : knows_another_(knows_another) {}

  void StopAnswering() { silent_.Notify(); }
  void Release() { released_.Notify(); }

  absl::Status Join(const Member&) override { return absl::OkStatus(); }
  absl::StatusOr<std::vector<Member>> Renew(const Member& self) override {
    if (silent_.HasBeenNotified()) {
      released_.WaitFor(absl::Seconds(60));
      return absl::UnavailableError("the database is silent");
    }
    std::vector<Member> members = {self};
    if (knows_another_)
      members.push_back(
          {.owner = {.name = "b", .epoch = Epoch(2)}, .address = "b:7700", .renewals = ++renewals_});
    return members;
  }
  absl::Status Leave(Epoch) override { return absl::OkStatus(); }
  absl::StatusOr<bool> Expel(Epoch, int64_t) override { return false; }
  absl::StatusOr<std::vector<ledger::AdoptedJob>> AdoptOrphans(const ledger::Owner&) override {
    return std::vector<ledger::AdoptedJob>();
  }

 private:
  const bool knows_another_;
  int64_t renewals_ = 0;
  threads::Event silent_;
  threads::Event released_;
};

class FakeHost final : public MemberHost {
 public:
  void SetMetrics(Member*) override {}
  void Adopt(const std::vector<ledger::AdoptedJob>&) override {}
  void MoveWorkers(const WorkerMove&) override {}
  void SendWorkersAway(const std::string& address) override {
    absl::MutexLock lock(&mutex_);
    sent_to_.push_back(address);
  }
  void OnExpelled() override {}
  void LookAtOthers() override {}

  std::vector<std::string> sent_to() const {
    absl::MutexLock lock(&mutex_);
    return sent_to_;
  }
  void AwaitSendingAway() const {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(
        +[](const std::vector<std::string>* sent_to) { return !sent_to->empty(); }, &sent_to_));
  }

 private:
  mutable absl::Mutex mutex_;
  std::vector<std::string> sent_to_ ABSL_GUARDED_BY(mutex_);
};

class MembershipTest : public ::testing::TestWithParam<bool> {};

TEST_P(MembershipTest, SendsWorkersAwayWhileTheDatabaseIsSilent) {
  FakeRoster roster(/*knows_another=*/GetParam());
  FakeHost host;
  Membership membership({.owner = {.name = "a", .epoch = Epoch(1)},
                         .address = "a:7700",
                         .lease = kLease,
                         .log = std::make_shared<spdlog::logger>("test")},
                        &roster, &host);
  ASSERT_TRUE(membership.Start().ok());
  roster.StopAnswering();
  // The call of the roster has not returned.
  host.AwaitSendingAway();
  EXPECT_EQ(host.sent_to().front(), GetParam() ? "b:7700" : "");
  roster.Release();
  membership.Stop();
}

INSTANTIATE_TEST_SUITE_P(AnotherIsKnown, MembershipTest, ::testing::Bool());

}  // namespace
}  // namespace lumifold::cluster
