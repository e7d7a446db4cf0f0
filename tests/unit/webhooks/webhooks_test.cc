#include "server/webhooks/webhooks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/null_sink.h>
#include <spdlog/spdlog.h>

#include <atomic>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "proto/threads/event.h"
#include "server/ledger/sqlite_job_store.h"
#include "server/webhooks/message.h"
#include "server/webhooks/secret.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/ledger/job_store_fixture.h"
#include "tests/unit/webhooks/receiver.h"

namespace lumifold::webhooks {
namespace {

using absl::StatusCode;
using ledger::Owned;

class WebhooksTest : public ::testing::Test {
 protected:
  /// A coordinator that may call the hosts.
  std::unique_ptr<Webhooks> Open(const std::string& hosts) {
    absl::StatusOr<std::unique_ptr<Webhooks>> webhooks = Webhooks::Open(
        {.hosts = hosts, .secret_path = "", .ca_path = ""},
        {.secret_path = folder_.PathOf("webhook.secret"),
         .queue = &store_->deliveries(),
         .wall_now = [this] { return absl::Now() + absl::Hours(hours_later_.load()); },
         .random = [this] { return ++random_; },
         .log = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::null_sink_mt>())});
    EXPECT_TRUE(webhooks.ok()) << webhooks.status();
    return *std::move(webhooks);
  }

  /// Ends a new job whose webhook is the URL.
  void EndJob(const std::string& id, const std::string& url, Webhooks& webhooks) {
    ASSERT_TRUE(store_->CreateJob(ledger::Job(id, id)).ok());
    v1::JobStatus ended;
    ended.set_job_id(id);
    ended.set_state(v1::JOB_STATE_DONE);
    ended.mutable_scheduling()->set_webhook(url);
    ASSERT_TRUE(store_->EndJob(Owned(id), {v1::JOB_STATE_DONE, "", webhooks.DeliveryOf(ended)}).ok());
    webhooks.Wake();
  }

  /// An empty one where there is none.
  static v1::WebhookDelivery StatusOf(const Webhooks& webhooks, const std::string& job) {
    return webhooks.StatusOf(job).value_or(std::nullopt).value_or(v1::WebhookDelivery());
  }

  static v1::WebhookCounts CountsOf(const Webhooks& webhooks) {
    return webhooks.counts().value_or(v1::WebhookCounts());
  }

  static void AwaitState(const Webhooks& webhooks, const std::string& job, v1::WebhookDelivery::State state) {
    while (StatusOf(webhooks, job).state() != state) absl::SleepFor(absl::Milliseconds(5));
  }

  TempFolder folder_;
  std::unique_ptr<ledger::JobStore> store_ = *ledger::OpenSqliteJobStore(folder_.PathOf("ledger.db"));
  std::atomic<int> hours_later_ = 0;
  std::atomic<uint64_t> random_ = 0;
};

TEST_F(WebhooksTest, AReceiverThatFailsIsAskedAgainWithTheSameMessage) {
  std::atomic<int> calls = 0;
  const Receiver receiver(
      [&calls](const http::Request&) { return http::Response{.status = ++calls <= 2 ? 500 : 200}; });
  const std::unique_ptr<Webhooks> webhooks = Open(receiver.host());
  webhooks->Start();
  EndJob("j-a", receiver.UrlOf("/hook"), *webhooks);
  AwaitState(*webhooks, "j-a", v1::WebhookDelivery::STATE_DELIVERED);
  const std::vector<http::Request> requests = receiver.requests();
  ASSERT_EQ(requests.size(), 3u);
  const std::string secret = *ReadSecret(folder_.PathOf("webhook.secret"));
  for (const http::Request& request : requests) {
    EXPECT_EQ(request.body, requests.front().body);
    EXPECT_EQ(request.Header("X-Lumifold-Delivery"), requests.front().Header("X-Lumifold-Delivery"));
    EXPECT_EQ(request.Header("Content-Type"), "application/json");
    int64_t timestamp = 0;
    ASSERT_TRUE(absl::SimpleAtoi(request.Header("X-Lumifold-Timestamp"), &timestamp));
    EXPECT_EQ(request.Header("X-Lumifold-Signature"), SignatureOf(secret, timestamp, request.body));
  }
  const v1::WebhookDelivery delivery = StatusOf(*webhooks, "j-a");
  EXPECT_EQ(delivery.tries(), 3);
  EXPECT_THAT(delivery.error(), ::testing::HasSubstr("500"));
  EXPECT_EQ(CountsOf(*webhooks).delivered(), 1);
  EXPECT_EQ(CountsOf(*webhooks).failed(), 2);
}

TEST_F(WebhooksTest, PausesGrowToAQuarterOfAnHour) {
  EXPECT_EQ(PauseAfter(1), absl::Seconds(1));
  EXPECT_EQ(PauseAfter(2), absl::Seconds(2));
  EXPECT_EQ(PauseAfter(9), absl::Seconds(256));
  EXPECT_EQ(PauseAfter(100), absl::Minutes(15));
}

TEST_F(WebhooksTest, AReceiverThatHangsGetsAFewCallsAtATimeAndDelaysNoOther) {
  threads::Event stop;
  std::atomic<int> at_a_time = 0;
  const Receiver hangs([&](const http::Request&) {
    ++at_a_time;
    stop.WaitFor(absl::Hours(1));
    return http::Response();
  });
  const Receiver works;
  const std::unique_ptr<Webhooks> webhooks = Open(absl::StrCat(hangs.host(), ",", works.host()));
  for (int i = 0; i < 20; ++i) EndJob(absl::StrCat("j-", i), hangs.UrlOf("/"), *webhooks);
  EndJob("j-other", works.UrlOf("/"), *webhooks);
  webhooks->Start();
  AwaitState(*webhooks, "j-other", v1::WebhookDelivery::STATE_DELIVERED);
  EXPECT_LE(at_a_time.load(), 4);
  EXPECT_EQ(CountsOf(*webhooks).delivered(), 1);
  webhooks->Stop();  // does not wait for what hangs
  stop.Notify();
}

TEST_F(WebhooksTest, WhatWasBrokenOffIsSentByTheNextStart) {
  threads::Event stop;
  std::atomic<int> calls = 0;
  const Receiver receiver([&](const http::Request&) {
    if (++calls == 1) stop.WaitFor(absl::Hours(1));
    return http::Response();
  });
  {
    const std::unique_ptr<Webhooks> first = Open(receiver.host());
    first->Start();
    EndJob("j-a", receiver.UrlOf("/"), *first);
    while (calls == 0) absl::SleepFor(absl::Milliseconds(5));
  }
  stop.Notify();
  const std::unique_ptr<Webhooks> second = Open(receiver.host());
  second->Start();
  AwaitState(*second, "j-a", v1::WebhookDelivery::STATE_DELIVERED);
  EXPECT_EQ(StatusOf(*second, "j-a").tries(), 2);
}

TEST_F(WebhooksTest, AfterADayAMessageIsGivenUp) {
  const Receiver receiver([](const http::Request&) { return http::Response{.status = 500}; });
  const std::unique_ptr<Webhooks> webhooks = Open(receiver.host());
  EndJob("j-a", receiver.UrlOf("/"), *webhooks);
  webhooks->Start();
  receiver.Await(1);
  hours_later_ = 25;
  AwaitState(*webhooks, "j-a", v1::WebhookDelivery::STATE_GIVEN_UP);
}

TEST_F(WebhooksTest, WithoutHostsNothingIsRecordedAndNoSecretIsMade) {
  const std::unique_ptr<Webhooks> webhooks = Open("");
  webhooks->Start();
  EXPECT_EQ(webhooks->Check("http://127.0.0.1/").code(), StatusCode::kFailedPrecondition);
  EndJob("j-a", "http://127.0.0.1/", *webhooks);
  EXPECT_EQ(*webhooks->StatusOf("j-a"), std::nullopt);
  EXPECT_EQ(webhooks->counts(), std::nullopt);
  EXPECT_EQ(ReadSecret(folder_.PathOf("webhook.secret")).status().code(), StatusCode::kNotFound);
}

TEST_F(WebhooksTest, AHostThatIsNoLongerAllowedIsNotCalled) {
  const Receiver receiver;
  {
    const std::unique_ptr<Webhooks> before = Open(receiver.host());
    EndJob("j-a", receiver.UrlOf("/"), *before);
  }
  const Receiver other;
  const std::unique_ptr<Webhooks> after = Open(other.host());
  after->Start();
  EndJob("j-b", other.UrlOf("/"), *after);
  AwaitState(*after, "j-b", v1::WebhookDelivery::STATE_DELIVERED);
  EXPECT_EQ(StatusOf(*after, "j-a").state(), v1::WebhookDelivery::STATE_WAITING);
  EXPECT_TRUE(receiver.requests().empty());
}

}  // namespace
}  // namespace lumifold::webhooks
