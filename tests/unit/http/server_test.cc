#include "proto/http/server.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "proto/rpc/monotonic.h"
#include "proto/threads/event.h"
#include "tests/unit/http/raw_caller.h"

namespace lumifold::http {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

Response Hello(const Request&) { return {.content_type = "text/plain", .body = "hello"}; }

TEST(HttpServer, AnswersHaveTheHeadersOfAll) {
  const TestServer test({.headers = {{"X-All", "1"}}, .handler = [](const Request& request) {
                           if (request.path == "/none") return Response{.status = 204};
                           return Response{.status = 404, .body = "no\n", .headers = {{"X-One", "2"}}};
                         }});
  EXPECT_EQ(
      test.Ask(kGet),
      "HTTP/1.1 404 Not Found\r\nConnection: close\r\nContent-Length: 3\r\nX-All: 1\r\nX-One: 2\r\n\r\nno\n");
  EXPECT_EQ(test.Ask("GET /none HTTP/1.0\r\n\r\n"),
            "HTTP/1.1 204 No Content\r\nConnection: close\r\nX-All: 1\r\n\r\n");
  EXPECT_EQ(
      test.Ask("x\r\n\r\n"),
      "HTTP/1.1 400 Bad Request\r\nConnection: close\r\nContent-Length: 12\r\nContent-Type: text/plain; "
      "charset=utf-8\r\nX-All: 1\r\n\r\nBad Request\n");
}

TEST(HttpServer, AHandlerThatThrowsIsAnError) {
  const TestServer test({.handler = [](const Request&) -> Response { throw std::runtime_error("secret"); }});
  for (int i = 0; i < 3; ++i)
    EXPECT_THAT(test.Ask(kGet),
                AllOf(StartsWith("HTTP/1.1 500 Internal Server Error\r\n"), EndsWith("Error\n")));
}

TEST(HttpServer, StreamsPiecesUntilTheirEnd) {
  std::atomic<int> streams = 0;
  const TestServer test({.handler = [&](const Request&) {
    const std::shared_ptr<int> next(new int(0), [&](const int* last) {
      delete last;
      --streams;
    });
    ++streams;
    return Response{.stream = [next]() -> std::optional<std::string> {
                      if (++*next == 4) return std::nullopt;
                      return *next == 2 ? "" : absl::StrCat("piece ", *next);
                    },
                    .pause = absl::Milliseconds(10)};
  }});
  RawCaller caller = test.Caller();
  caller.Send("GET / HTTP/1.1\r\n\r\n");
  EXPECT_EQ(caller.ReadTo("\r\n0\r\n\r\n"),
            "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n7\r\npiece 1\r\n7\r\npiece 3\r\n0\r\n\r\n");
  caller.Send("HEAD / HTTP/1.1\r\nConnection: close\r\n\r\n");
  EXPECT_EQ(caller.ReadAll(), "HTTP/1.1 200 OK\r\nConnection: close\r\nTransfer-Encoding: chunked\r\n\r\n");
  EXPECT_EQ(test.Ask("GET / HTTP/1.0\r\n\r\n"), "HTTP/1.1 200 OK\r\nConnection: close\r\n\r\npiece 1piece 3");
  test.server->Stop();
  EXPECT_EQ(streams, 0);
}

TEST(HttpServer, AStreamOfKnownLengthStatesIt) {
  const TestServer test({.handler = [&](const Request& request) {
    const auto next = std::make_shared<int>(0);
    return Response{
        .stream = [next, fails = request.path == "/fails"]() -> absl::StatusOr<std::optional<std::string>> {
          if (fails && *next == 1) return absl::UnavailableError("lost");
          if (++*next == 3) return std::nullopt;
          return absl::StrCat("piece ", *next);
        },
        .stream_bytes = request.path == "/" ? 14 : 20};
  }});
  RawCaller caller = test.Caller();
  caller.Send("GET / HTTP/1.1\r\n\r\n");
  EXPECT_EQ(caller.ReadTo("piece 2"), "HTTP/1.1 200 OK\r\nContent-Length: 14\r\n\r\npiece 1piece 2");
  caller.Send("GET /short HTTP/1.1\r\n\r\n");  // over the same connection, which then is closed
  EXPECT_EQ(caller.ReadAll(), "HTTP/1.1 200 OK\r\nContent-Length: 20\r\n\r\npiece 1piece 2");
  EXPECT_EQ(test.Ask("GET /fails HTTP/1.1\r\n\r\n"), "HTTP/1.1 200 OK\r\nContent-Length: 20\r\n\r\npiece 1");
}

TEST(HttpServer, AStreamThatFailsHasNoEnd) {
  const TestServer test({.handler = [&](const Request&) {
    const auto next = std::make_shared<int>(0);
    return Response{.stream = [next]() -> absl::StatusOr<std::optional<std::string>> {
      if (++*next == 2) return absl::UnavailableError("lost");
      return "piece";
    }};
  }});
  EXPECT_EQ(test.Ask("GET / HTTP/1.1\r\n\r\n"),
            "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n5\r\npiece\r\n");
}

TEST(HttpServer, AStreamGoesWithItsCaller) {
  std::atomic<int> streams = 0;
  const TestServer test({.handler = [&](const Request&) {
    const std::shared_ptr<int> token(new int(0), [&](const int* last) {
      delete last;
      --streams;
    });
    ++streams;
    return Response{.stream = [token] { return "piece"; }, .pause = absl::Milliseconds(10)};
  }});
  {
    RawCaller caller = test.Caller();
    caller.Send(kGet);
    EXPECT_THAT(caller.ReadTo("piece"), HasSubstr("piece"));
    EXPECT_EQ(streams, 1);
  }
  const absl::Time begin = rpc::MonotonicNow();
  while (streams != 0 && rpc::MonotonicNow() - begin < absl::Seconds(20)) std::this_thread::yield();
  EXPECT_EQ(streams, 0);
}

TEST(HttpServer, StopEndsWhatWaitsAndIsPrompt) {
  const TestServer test({.limits = {.request_time = absl::Minutes(5),
                                    .idle_time = absl::Minutes(5),
                                    .write_time = absl::Minutes(5)},
                         .handler = [](const Request& request) {
                           if (request.path == "/large") return Response{.body = std::string(16 << 20, 'x')};
                           return Response{.stream = [] { return "piece"; }, .pause = absl::Hours(1)};
                         }});
  RawCaller idle = test.Caller();
  RawCaller slow = test.Caller();
  slow.Send("GET /");
  RawCaller deaf = test.Caller();
  deaf.Send("GET /large HTTP/1.1\r\n\r\n");
  deaf.ReadTo("\r\n\r\n");  // of the answer no more
  RawCaller watching = test.Caller();
  watching.Send("GET / HTTP/1.1\r\n\r\n");
  watching.ReadTo("piece\r\n");
  const absl::Time begin = rpc::MonotonicNow();
  std::thread stopping([&test] { test.server->Stop(); });
  EXPECT_EQ(watching.ReadAll(), "0\r\n\r\n");
  stopping.join();
  EXPECT_LT(rpc::MonotonicNow() - begin, absl::Minutes(1)) << "a second, and a loaded machine";
  EXPECT_EQ(idle.ReadAll(), "");
  EXPECT_EQ(slow.ReadAll(), "");
  test.server->Stop();
}

TEST(HttpServer, StopWaitsForHandlersAndSendsTheirAnswers) {
  threads::Event runs;
  threads::Event goes_on;
  const TestServer test({.handler = [&](const Request& request) {
    runs.Notify();
    goes_on.WaitFor(absl::Minutes(1));
    return Hello(request);
  }});
  RawCaller caller = test.Caller();
  caller.Send("GET / HTTP/1.1\r\n\r\n");
  ASSERT_TRUE(runs.WaitFor(absl::Minutes(1)));
  std::atomic<bool> is_stopped = false;
  std::thread stopping([&] {
    test.server->Stop();
    is_stopped = true;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_FALSE(is_stopped);
  goes_on.Notify();
  EXPECT_THAT(caller.ReadAll(), AllOf(HasSubstr("Connection: close"), EndsWith("hello")));
  stopping.join();
}

TEST(HttpServer, CallersPastTheLimitWaitAndNoHandlerIsCutOff) {
  std::atomic<int> running = 0;
  threads::Event goes_on;
  const TestServer test({.limits = {.connections = 2, .patience = absl::ZeroDuration()},
                         .handler = [&](const Request& request) {
                           ++running;
                           goes_on.WaitFor(absl::Minutes(1));
                           return Hello(request);
                         }});
  std::vector<RawCaller> callers;
  for (int i = 0; i < 5; ++i) {
    callers.push_back(test.Caller());
    callers.back().Send(kGet);
  }
  while (running < 2) std::this_thread::yield();
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  EXPECT_EQ(running, 2);
  goes_on.Notify();
  for (RawCaller& caller : callers) EXPECT_THAT(caller.ReadAll(), EndsWith("hello"));
}

TEST(HttpServer, HandlersPastTheirNumberWait) {
  absl::Mutex mutex;
  int running = 0;
  int most = 0;
  const TestServer test({.limits = {.threads = 3}, .handler = [&](const Request& request) {
                           absl::MutexLock lock(&mutex);
                           most = std::max(most, ++running);
                           const auto all_run = [&most] { return most >= 3; };
                           EXPECT_TRUE(mutex.AwaitWithTimeout(absl::Condition(&all_run), absl::Minutes(1)));
                           // Time for one too many.
                           const auto never = [] { return false; };
                           mutex.AwaitWithTimeout(absl::Condition(&never), absl::Milliseconds(20));
                           --running;
                           return Hello(request);
                         }});
  std::vector<RawCaller> callers;
  for (int i = 0; i < 12; ++i) {
    callers.push_back(test.Caller());
    callers.back().Send(kGet);
  }
  for (RawCaller& caller : callers) EXPECT_THAT(caller.ReadAll(), EndsWith("hello"));
  EXPECT_EQ(most, 3);
}

TEST(HttpServer, WithoutADescriptorItWaitsForOne) {
  const TestServer test({.handler = Hello});
  RawCaller caller;
  std::vector<rpc::FileHandle> all;
  rlimit limit = {};
  getrlimit(RLIMIT_NOFILE, &limit);
  const rlimit few = {.rlim_cur = 256, .rlim_max = limit.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &few), 0);
  while (all.empty() || all.back().get() >= 0) all.emplace_back(fcntl(caller.socket(), F_DUPFD_CLOEXEC, 0));
  caller.Connect(test.listening.port);
  caller.Send(kGet);
  rusage before = {};
  getrusage(RUSAGE_SELF, &before);
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  rusage after = {};
  getrusage(RUSAGE_SELF, &after);
  const absl::Duration used =
      absl::DurationFromTimeval(after.ru_utime) + absl::DurationFromTimeval(after.ru_stime) -
      absl::DurationFromTimeval(before.ru_utime) - absl::DurationFromTimeval(before.ru_stime);
  EXPECT_LT(used, absl::Milliseconds(250));
  all.clear();
  EXPECT_THAT(caller.ReadAll(), EndsWith("hello"));
  setrlimit(RLIMIT_NOFILE, &limit);
}

TEST(HttpServer, ChildrenInheritNoSocket) {
  const TestServer test({.handler = Hello});
  RawCaller caller = test.Caller();
  caller.Send("GET / HTTP/1.1\r\n\r\n");
  EXPECT_THAT(caller.ReadTo("hello"), EndsWith("hello"));
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    const std::string target = std::filesystem::read_symlink(entry.path(), gone).string();
    const int fd = std::stoi(entry.path().filename().string());
    const bool is_inherited =
        fd > 2 && target.starts_with("socket:") && (fcntl(fd, F_GETFD) & FD_CLOEXEC) == 0;
    EXPECT_FALSE(is_inherited) << target;
  }
}

TEST(HttpServer, ARenewedCertificateIsUsed) {
  TempFolder first_folder;
  TempFolder second_folder;
  const std::string path = WriteCertificate(first_folder);
  const TestServer test({.certificate_path = path, .handler = Hello});
  RawCaller caller = test.Caller();
  const std::string first = caller.Certificate();
  EXPECT_EQ(test.Caller().Certificate(), first);
  std::filesystem::rename(WriteCertificate(second_folder), path);
  const std::string second = test.Caller().Certificate();
  EXPECT_NE(second, first);
  std::ofstream(path) << "half a certificate";
  EXPECT_EQ(test.Caller().Certificate(), second);
  std::filesystem::remove(path);
  EXPECT_EQ(test.Caller().Certificate(), second);
  caller.Send(kGet);
  EXPECT_THAT(caller.ReadAll(), EndsWith("hello")) << "the connection of before";
  EXPECT_EQ(Server::Start({.listening = &test.listening.sockets, .certificate_path = path, .handler = Hello})
                .status()
                .code(),
            absl::StatusCode::kUnavailable);
}

TEST(HttpServer, ConnectionsWaitUntilThereIsAServer) {
  const sockets::ListeningSockets listening = *sockets::ListenAt("127.0.0.1:0");
  for (int i = 0; i < 2; ++i) {
    RawCaller caller(listening.port);
    caller.Send(kGet);
    const auto server = Server::Start({.listening = &listening.sockets, .handler = Hello});
    ASSERT_TRUE(server.ok());
    EXPECT_THAT(caller.ReadAll(), EndsWith("hello"));
  }
}

}  // namespace
}  // namespace lumifold::http
