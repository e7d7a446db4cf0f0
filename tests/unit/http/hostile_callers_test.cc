// Slow and hostile callers against what the status page and the metrics are served with: their limits, with
// shorter times.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "proto/monitoring/endpoint.h"
#include "proto/rpc/monotonic.h"
#include "tests/unit/http/raw_caller.h"

namespace lumifold::http {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

struct Config {
  const char* name;
  bool uses_tls;
  Limits limits;

  /// For the names of tests, which would else have its bytes.
  friend void PrintTo(const Config& config, std::ostream* out) { *out << config.name; }
};

/// More than any answer that the kernel takes for a caller who does not read.
constexpr size_t kLargeBytes = 16 << 20;

/// A server without the limit would stay silent; one of a loaded machine is late.
constexpr absl::Duration kPatience = absl::Minutes(2);

class HostileCallers : public ::testing::TestWithParam<Config> {
 protected:
  HostileCallers() : server_(Options()) {}

  ServerOptions Options() {
    ServerOptions options{.limits = limits_,
                          .handler = [this](const Request& request) { return Answer(request); }};
    if (GetParam().uses_tls) options.certificate_path = WriteCertificate(folder_);
    return options;
  }
  static Limits QuickLimits() {
    Limits limits = GetParam().limits;
    limits.handshake_time = limits.request_time = limits.idle_time = limits.write_time =
        absl::Milliseconds(400);
    limits.patience = absl::Milliseconds(100);
    return limits;
  }
  Response Answer(const Request& request) {
    ++calls_;
    const bool is_large = request.path == "/large";
    return {.content_type = "text/plain",
            .body = is_large ? std::string(kLargeBytes, 'x') : absl::StrCat(request.path, " ", request.body)};
  }
  /// Sends a byte now and then until the server closes. The time until then.
  static absl::Duration Drip(RawCaller caller, absl::string_view start) {
    const absl::Time begin = rpc::MonotonicNow();
    caller.Send(start);
    while (caller.Send("x") && rpc::MonotonicNow() - begin < kPatience)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_EQ(caller.ReadAll(), "");
    return rpc::MonotonicNow() - begin;
  }
  void ExpectInTime(absl::Duration time) const {
    EXPECT_GT(time, limits_.request_time * 0.9);
    EXPECT_LT(time, kPatience);
  }
  void ExpectHonestCallersAreServed() const {
    EXPECT_THAT(server_.Ask(kGet), StartsWith("HTTP/1.1 200 OK\r\n"));
  }

  const Limits limits_ = QuickLimits();
  TempFolder folder_;
  std::atomic<int> calls_ = 0;
  TestServer server_;
};

TEST_P(HostileCallers, WhatIsNoRequestIsRefusedOnceAndNotAnswered) {
  const std::string post = "POST / HTTP/1.1\r\nHost: a\r\n";
  const std::string many = std::string(limits_.header_bytes, 'a');
  std::string lines;
  while (lines.size() < limits_.header_bytes) lines += "A: b\r\n";
  const std::vector<std::pair<std::string, int>> cases = {
      {"\r\n\r\n", 400},
      {"\x16\x03\x01\x02\r\n\r\n", 400},
      {"get / HTTP/1.1\r\n\r\n", 400},
      {"G<T / HTTP/1.1\r\n\r\n", 400},
      {"GET  / HTTP/1.1\r\n\r\n", 400},
      {"GET /\r\n\r\n", 400},
      {"GET http://a/ HTTP/1.1\r\n\r\n", 400},
      {"GET * HTTP/1.1\r\n\r\n", 400},
      {"GET / HTTP/0.9\r\n\r\n", 400},
      {"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", 400},
      {"GET / HTTP/1.1\nHost: a\n\n\r\n\r\n", 400},
      {"GET / HTTP/1.1\r\nHost : a\r\n\r\n", 400},
      {"GET / HTTP/1.1\r\n: a\r\n\r\n", 400},
      {absl::StrCat("GET / HTTP/1.1\r\nA: ", std::string(1, '\0'), "\r\n\r\n"), 400},
      {"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", 400},
      {"GET / HTTP/1.1\r\nA: " + many, 431},
      {"GET /" + many, 431},
      {"GET / HTTP/1.1\r\n" + lines, 431},
      // What two readers could take for requests of different lengths.
      {post + "Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400},
      {post + "Transfer-Encoding: chunked\r\nContent-Length: 3\r\n\r\n0\r\n\r\n", 400},
      {post + "Transfer-Encoding: gzip\r\nContent-Length: 3\r\n\r\nabc", 400},
      {post + "Content-Length: 3\r\nContent-Length: 3\r\n\r\nabc", 400},
      {post + "Content-Length: 3\r\nContent-Length: 4\r\n\r\nabc", 400},
      {post + "Content-Length: 3, 3\r\n\r\nabc", 400},
      {post + "Content-Length: +3\r\n\r\nabc", 400},
      {post + "Content-Length: -3\r\n\r\nabc", 400},
      {post + "Content-Length: 0x3\r\n\r\nabc", 400},
      {post + "Content-Length: \r\n\r\nabc", 400},
      {post + "Content-Length: 99999999999999999999999\r\n\r\nabc", 400},
      {absl::StrCat(post, "Content-Length: ", limits_.body_bytes + 1, "\r\n\r\nabc"), 413},
      {post + "Content-Length: 18446744073709551615\r\n\r\nabc", 413},
      {post + "Transfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n\r\n", 411},
      {post + "Transfer-Encoding: chunked\r\n\r\nzz\r\n\r\n", 411},
      {post + "Transfer-Encoding: xchunked\r\n\r\n", 411},
      {post + "Transfer-Encoding: chunked, identity\r\n\r\n", 411},
      {post + "Transfer-Encoding:\tchunked\r\n\r\n0\r\n\r\n", 411},
  };
  for (const auto& [request, status] : cases) {
    const std::string answer = server_.Ask(request + "GET /smuggled HTTP/1.1\r\n\r\n");
    EXPECT_THAT(answer, StartsWith(absl::StrCat("HTTP/1.1 ", status, " "))) << request.substr(0, 120);
    const std::vector<std::string> answers = absl::StrSplit(answer, "HTTP/1.1 ");
    EXPECT_EQ(answers.size(), 2u) << "one answer\n" << answer;
    EXPECT_THAT(answer, Not(HasSubstr("timeout")));
  }
  EXPECT_EQ(calls_, 0);
  ExpectHonestCallersAreServed();
}

TEST_P(HostileCallers, AByteNowAndThenDoesNotExtendTheTime) {
  ExpectInTime(Drip(server_.Caller(), "GET / HTTP/1.1\r\nA: "));
  ExpectInTime(Drip(server_.Caller(), "POST / HTTP/1.1\r\nContent-Length: 60000\r\n\r\n"));
  RawCaller silent = server_.Caller();
  const absl::Time begin = rpc::MonotonicNow();
  EXPECT_EQ(silent.ReadAll(), "");
  ExpectInTime(rpc::MonotonicNow() - begin);
  EXPECT_EQ(calls_, 0);
}

TEST_P(HostileCallers, SlowCallersDoNotKeepOthersOut) {
  ServerOptions options = Options();
  options.limits.handshake_time = options.limits.request_time = options.limits.idle_time = absl::Minutes(5);
  const TestServer server(options);
  std::vector<RawCaller> slow;
  for (size_t i = 0; i < 2 * limits_.connections; ++i) {
    slow.emplace_back(server.listening.port);
    if (i % 2 == 0) slow.back().Send("G");
  }
  EXPECT_THAT(server.Ask(kGet), StartsWith("HTTP/1.1 200 OK\r\n"));
}

TEST_P(HostileCallers, ARequestOfLessThanItsLengthIsNotAnswered) {
  for (const char* request : {"POST / HTTP/1.1\r\nContent-Length: 9\r\n\r\nabc", "GET / HT", ""}) {
    RawCaller caller = server_.Caller();
    caller.Send(request);
    caller.EndSending();
    EXPECT_EQ(caller.ReadAll(), "") << request;
  }
  EXPECT_EQ(calls_, 0);
}

TEST_P(HostileCallers, WhoSendsNoMoreStillGetsTheAnswer) {
  RawCaller caller = server_.Caller();
  caller.Send("GET /half HTTP/1.1\r\n\r\n");
  if (!GetParam().uses_tls) caller.EndSending();  // TLS has no half-closed connections
  EXPECT_THAT(caller.ReadTo("/half"), HasSubstr("\r\n\r\n/half "));
}

TEST_P(HostileCallers, WhoDoesNotReadIsLeft) {
  // A loaded machine may come to it late.
  size_t taken = kLargeBytes;
  for (absl::Duration wait = 3 * limits_.write_time; taken >= kLargeBytes && wait < kPatience; wait *= 2) {
    RawCaller caller = server_.Caller();
    caller.Send("GET /large HTTP/1.1\r\n\r\n");
    std::this_thread::sleep_for(absl::ToChronoMilliseconds(wait));
    taken = caller.ReadAll().size();
  }
  EXPECT_LT(taken, kLargeBytes);
  ExpectHonestCallersAreServed();
}

TEST_P(HostileCallers, PipelinedRequestsAreAnsweredInTheirOrder) {
  RawCaller caller = server_.Caller();
  caller.Send(
      "GET /1 HTTP/1.1\r\n\r\nPOST /2 HTTP/1.1\r\nContent-Length: 3\r\n\r\nabcHEAD /3 HTTP/1.1\r\n\r\n"
      "GET /4 HTTP/1.1\r\nConnection: close\r\n\r\nGET /5 HTTP/1.1\r\n\r\n");
  const std::string text = "Content-Type: text/plain\r\n\r\n";
  const std::string ok = "HTTP/1.1 200 OK\r\n";
  EXPECT_EQ(caller.ReadAll(),
            absl::StrCat(ok, "Content-Length: 3\r\n", text, "/1 ", ok, "Content-Length: 6\r\n", text,
                         "/2 abc", ok, "Content-Length: 3\r\n", text, ok,
                         "Connection: close\r\nContent-Length: 3\r\n", text, "/4 "));
  EXPECT_EQ(calls_, 4);
}

TEST_P(HostileCallers, BodiesUpToTheLimitAreRead) {
  const std::string body(limits_.body_bytes, 'b');
  const std::string answer =
      server_.Ask(absl::StrCat("POST / HTTP/1.0\r\nContent-Length: ", body.size(), "\r\n\r\n", body));
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200 OK\r\nConnection: close\r\n"));
  EXPECT_TRUE(absl::EndsWith(answer, body));
}

class HostileTlsCallers : public HostileCallers {};

TEST_P(HostileTlsCallers, WhoSpeaksNoTlsIsLeft) {
  for (const char* bytes : {"", "\x16\x03\x01\x02", "GET / HTTP/1.1\r\nHost: a\r\n\r\n"}) {
    RawCaller caller(server_.listening.port);
    caller.Send(bytes);
    EXPECT_THAT(caller.ReadAll(), Not(HasSubstr("HTTP")));
  }
  ExpectInTime(Drip(RawCaller(server_.listening.port), "\x16\x03\x01\x02\x01"));
  EXPECT_FALSE(RawCaller(server_.listening.port).StartTls(TLS1_1_VERSION));
  EXPECT_EQ(calls_, 0);
  ExpectHonestCallersAreServed();
}

std::string NameOf(const ::testing::TestParamInfo<Config>& tested) { return tested.param.name; }

const Config kPage = {"Page", false, Limits()};
const Config kPageOverTls = {"PageOverTls", true, Limits()};
const Config kMetrics = {"Metrics", false, monitoring::EndpointOptions().limits};

INSTANTIATE_TEST_SUITE_P(Http, HostileCallers, ::testing::Values(kPage, kPageOverTls, kMetrics), NameOf);
INSTANTIATE_TEST_SUITE_P(Http, HostileTlsCallers, ::testing::Values(kPageOverTls), NameOf);

}  // namespace
}  // namespace lumifold::http
