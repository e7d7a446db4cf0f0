#include "server/webhooks/poster.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/match.h"
#include "proto/threads/event.h"
#include "tests/unit/webhooks/receiver.h"

namespace lumifold::webhooks {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

std::vector<PostOutcome> AwaitOutcomes(Poster& poster) {
  std::vector<PostOutcome> outcomes;
  while (poster.in_flight() > 0) {
    for (PostOutcome& outcome : poster.Wait(absl::Seconds(1))) outcomes.push_back(std::move(outcome));
  }
  return outcomes;
}

absl::Status Post(Poster& poster, const std::string& url) {
  poster.Start({.number = 1, .url = url, .body = "{}", .headers = {"X-Test: yes"}});
  const std::vector<PostOutcome> outcomes = AwaitOutcomes(poster);
  EXPECT_THAT(outcomes, SizeIs(1));
  return outcomes.front().status;
}

std::string Text(const absl::Status& status) { return std::string(status.message()); }

TEST(WebhookPoster, SendsTheBodyAndTakesEach2xxForAccepted) {
  const Receiver receiver([](const http::Request& request) {
    return http::Response{.status = request.path == "/made" ? 201 : 200, .body = "thanks"};
  });
  const std::unique_ptr<Poster> poster = *Poster::Open("", RequestLimits());
  EXPECT_TRUE(Post(*poster, receiver.UrlOf("/made")).ok());
  EXPECT_TRUE(Post(*poster, receiver.UrlOf("/?job=1")).ok());
  const std::vector<http::Request> requests = receiver.requests();
  ASSERT_THAT(requests, SizeIs(2));
  EXPECT_EQ(requests[0].method, "POST");
  EXPECT_EQ(requests[0].body, "{}");
  EXPECT_EQ(requests[0].Header("X-Test"), "yes");
  EXPECT_TRUE(absl::StartsWith(requests[0].Header("User-Agent"), "lumifold/"));
  EXPECT_EQ(requests[0].Header("Authorization"), "");
  EXPECT_EQ(requests[1].query, "job=1");
}

TEST(WebhookPoster, FollowsNoRedirectionAndSaysWhatWasAnswered) {
  const Receiver elsewhere;
  const Receiver receiver([&elsewhere](const http::Request& request) {
    if (request.path == "/busy") return http::Response{.status = 503};
    return http::Response{.status = 307, .headers = {{"Location", elsewhere.UrlOf("/")}}};
  });
  const std::unique_ptr<Poster> poster = *Poster::Open("", RequestLimits());
  EXPECT_THAT(Text(Post(*poster, receiver.UrlOf("/secret"))),
              AllOf(HasSubstr("307"), Not(HasSubstr("secret"))));
  EXPECT_THAT(Text(Post(*poster, receiver.UrlOf("/busy"))), HasSubstr("503"));
  EXPECT_THAT(elsewhere.requests(), IsEmpty());
}

TEST(WebhookPoster, AReceiverThatIsAwayIsAnError) {
  std::string url;
  {
    url = Receiver().UrlOf("/secret");
  }
  const std::unique_ptr<Poster> poster = *Poster::Open("", RequestLimits());
  const absl::Status status = Post(*poster, url);
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(Text(status), AllOf(Not(IsEmpty()), Not(HasSubstr("secret"))));
}

TEST(WebhookPoster, AReceiverThatHangsIsLeftAfterTheLimit) {
  threads::Event stop;
  const Receiver receiver([&stop](const http::Request&) {
    stop.WaitFor(absl::Hours(1));
    return http::Response();
  });
  const std::unique_ptr<Poster> poster = *Poster::Open("", {.time = absl::Milliseconds(200)});
  EXPECT_THAT(Text(Post(*poster, receiver.UrlOf("/"))), HasSubstr("timed out"));
  stop.Notify();
}

TEST(WebhookPoster, AnAnswerWithoutEndIsCutOff) {
  const Receiver receiver([](const http::Request&) {
    return http::Response{.stream = [] { return std::optional<std::string>(std::string(4096, 'x')); }};
  });
  const std::unique_ptr<Poster> poster = *Poster::Open("", RequestLimits());
  EXPECT_TRUE(Post(*poster, receiver.UrlOf("/")).ok());
}

TEST(WebhookPoster, RequestsGoSideBySideAndCanBeBrokenOff) {
  threads::Event stop;
  const Receiver receiver([&stop](const http::Request& request) {
    if (request.path == "/slow") stop.WaitFor(absl::Hours(1));
    return http::Response();
  });
  const std::unique_ptr<Poster> poster = *Poster::Open("", RequestLimits());
  poster->Start({.number = 7, .url = receiver.UrlOf("/slow"), .body = "", .headers = {}});
  poster->Start({.number = 8, .url = receiver.UrlOf("/"), .body = "", .headers = {}});
  std::vector<PostOutcome> outcomes;
  while (outcomes.empty()) outcomes = poster->Wait(absl::Seconds(1));
  EXPECT_EQ(outcomes.front().number, 8);
  EXPECT_THAT(poster->Abort(), ::testing::ElementsAre(7));
  EXPECT_EQ(poster->in_flight(), 0u);
  stop.Notify();
}

TEST(WebhookPoster, AuthoritiesThatCannotBeReadAreAnError) {
  EXPECT_FALSE(Poster::Open("/nonexistent/ca.pem", RequestLimits()).ok());
}

}  // namespace
}  // namespace lumifold::webhooks
