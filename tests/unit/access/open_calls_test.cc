#include "server/access/open_calls.h"

#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "absl/synchronization/notification.h"

namespace lumifold::access {
namespace {

Identity Person(const std::string& id) {
  return {.kind = IdentityKind::kPerson, .name = "ann", .scopes = {Scope::kRead}, .id = id};
}

absl::Status RefuseB(const Identity& caller) {
  return caller.id == "b" ? absl::UnauthenticatedError("revoked") : absl::OkStatus();
}

TEST(OpenCalls, EndsTheCallsOfARefusedCallerOnce) {
  OpenCalls calls;
  std::vector<std::string> ended;
  const auto note = [&ended](const char* call) {
    return [&ended, call](const absl::Status& why) {
      ended.push_back(std::string(call) + ":" + std::string(why.message()));
    };
  };
  calls.Add(Person("a"), note("first"));
  calls.Add(Person("b"), note("second"));
  calls.Add(Person("b"), note("third"));
  EXPECT_EQ(calls.EndUnless(RefuseB), 2u);
  EXPECT_EQ(calls.EndUnless(RefuseB), 0u);
  EXPECT_EQ(ended, (std::vector<std::string>{"second:revoked", "third:revoked"}));
}

TEST(OpenCalls, EndsCallsWhoseDeadlineIsOver) {
  OpenCalls calls;
  std::vector<std::string> ended;
  const auto note = [&ended](const char* call) {
    return [&ended, call](const absl::Status&) { ended.emplace_back(call); };
  };
  const absl::Time now = absl::UnixEpoch();
  const absl::Status why = absl::DeadlineExceededError("stalled");
  const uint64_t first = calls.Add(Person("a"), note("first"));
  const uint64_t second = calls.Add(Person("b"), note("second"));
  calls.Add(Person("b"), note("never"));
  calls.SetDeadline(first, now + absl::Seconds(10));
  calls.SetDeadline(second, now + absl::Seconds(10));
  EXPECT_EQ(calls.EndOverdue(now + absl::Seconds(9), why), 0u);
  calls.SetDeadline(first, now + absl::Seconds(19));  // it moved
  calls.SetEnd(second, note("second, otherwise"));
  EXPECT_EQ(calls.EndOverdue(now + absl::Seconds(18), why), 1u);
  EXPECT_EQ(calls.EndOverdue(now + absl::Seconds(18), why), 0u);
  calls.SetDeadline(first, absl::InfiniteFuture());
  EXPECT_EQ(calls.EndOverdue(now + absl::Hours(1), why), 0u);
  EXPECT_EQ(ended, std::vector<std::string>{"second, otherwise"});
}

TEST(OpenCalls, DoesNotEndACallThatIsGone) {
  OpenCalls calls;
  const uint64_t call = calls.Add(Person("b"), [](const absl::Status&) { FAIL(); });
  calls.Remove(call);
  EXPECT_EQ(calls.EndUnless(RefuseB), 0u);
  EXPECT_EQ(calls.size(), 0u);
}

TEST(OpenCalls, MayBeRemovedByItsEnd) {
  OpenCalls calls;
  uint64_t call = 0;
  call = calls.Add(Person("b"), [&](const absl::Status&) { calls.Remove(call); });
  EXPECT_EQ(calls.EndUnless(RefuseB), 1u);
  EXPECT_EQ(calls.size(), 0u);
}

TEST(OpenCalls, RemoveWaitsForTheEndOnAnotherThread) {
  OpenCalls calls;
  absl::Notification entered;
  absl::Notification may_return;
  std::atomic<bool> has_returned = false;
  const uint64_t call = calls.Add(Person("b"), [&](const absl::Status&) {
    entered.Notify();
    may_return.WaitForNotification();
    has_returned = true;
  });
  std::thread poller([&calls] { calls.EndUnless(RefuseB); });
  entered.WaitForNotification();
  std::thread releaser([&may_return] { may_return.Notify(); });
  calls.Remove(call);
  EXPECT_TRUE(has_returned);
  poller.join();
  releaser.join();
}

}  // namespace
}  // namespace lumifold::access
