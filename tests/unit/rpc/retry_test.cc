#include "proto/rpc/retry.h"

#include <gmock/gmock.h>
#include <grpcpp/client_context.h>
#include <gtest/gtest.h>

#include <vector>

#include "absl/time/clock.h"

namespace lumifold::rpc {
namespace {

using ::testing::ElementsAre;

class RetryTest : public ::testing::Test {
 protected:
  absl::Status Call(Idempotency idempotency, std::vector<absl::Status> answers) {
    return CallWithRetry(policy_, idempotency,
                         {.now = [this] { return now_; },
                          .sleep =
                              [this](absl::Duration pause) {
                                pauses_.push_back(pause);
                                now_ += pause;
                              },
                          .jitter = [this] { return jitter_; }},
                         [&](grpc::ClientContext& context) {
                           deadlines_.push_back(absl::FromChrono(context.deadline()));
                           const size_t i = static_cast<size_t>(calls_++);
                           return i < answers.size() ? answers[i] : answers.back();
                         });
  }

  RetryPolicy policy_;
  absl::Time now_ = absl::FromUnixSeconds(1'000'000);
  double jitter_ = 0.0;
  int calls_ = 0;
  std::vector<absl::Duration> pauses_;
  std::vector<absl::Time> deadlines_;
};

TEST_F(RetryTest, TriesAgainUntilItWorks) {
  const absl::Status lost = absl::UnavailableError("lost");
  EXPECT_TRUE(Call(Idempotency::kIdempotent, {lost, lost, absl::OkStatus()}).ok());
  EXPECT_EQ(calls_, 3);
  EXPECT_THAT(pauses_, ElementsAre(absl::Milliseconds(100), absl::Milliseconds(200)));
}

TEST_F(RetryTest, JitterShortensPausesByUpToAHalf) {
  jitter_ = 1.0;
  EXPECT_TRUE(Call(Idempotency::kIdempotent, {absl::AbortedError(""), absl::OkStatus()}).ok());
  EXPECT_THAT(pauses_, ElementsAre(absl::Milliseconds(50)));
}

TEST_F(RetryTest, ACallThatIsNotIdempotentIsMadeOnce) {
  EXPECT_FALSE(Call(Idempotency::kNotIdempotent, {absl::UnavailableError("lost")}).ok());
  EXPECT_EQ(calls_, 1);
}

TEST_F(RetryTest, AnErrorForGoodEndsIt) {
  EXPECT_EQ(Call(Idempotency::kIdempotent, {absl::NotFoundError("no job j-1")}).code(),
            absl::StatusCode::kNotFound);
  EXPECT_EQ(calls_, 1);
}

TEST_F(RetryTest, GivesUpAfterMaxTries) {
  policy_.max_tries = 4;
  EXPECT_EQ(Call(Idempotency::kIdempotent, {absl::DeadlineExceededError("slow")}).code(),
            absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(calls_, 4);
}

TEST_F(RetryTest, BeginsNoTryAfterTheTotalTimeout) {
  policy_.max_tries = 1000;
  policy_.total_timeout = absl::Seconds(20);
  EXPECT_FALSE(Call(Idempotency::kIdempotent, {absl::UnavailableError("lost")}).ok());
  EXPECT_LE(now_, absl::FromUnixSeconds(1'000'020));
  for (const absl::Duration pause : pauses_) EXPECT_LE(pause, policy_.pauses.longest);
}

TEST_F(RetryTest, EachTryHasADeadlineOfItsOwn) {
  policy_.try_timeout = absl::Seconds(7);
  const absl::Time before = absl::Now();
  EXPECT_TRUE(Call(Idempotency::kIdempotent, {absl::UnavailableError("lost"), absl::OkStatus()}).ok());
  ASSERT_EQ(deadlines_.size(), 2u);
  for (const absl::Time deadline : deadlines_) {
    EXPECT_GE(deadline, before + absl::Seconds(6.9));
    EXPECT_LE(deadline, absl::Now() + absl::Seconds(7.1));
  }
  EXPECT_GT(deadlines_[1], deadlines_[0]);
}

}  // namespace
}  // namespace lumifold::rpc
