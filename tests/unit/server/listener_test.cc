#include "server/net/listener.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/ostream_sink.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;

constexpr char kPreface[] = "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
constexpr char kClientHello[] = "\x16\x03\x01\x02";

class ListenerTest : public ::testing::Test {
 protected:
  void Open(ListenerOptions options, std::function<absl::Time()> now = rpc::MonotonicNow) {
    options.address = "127.0.0.1:0";
    options.now = std::move(now);
    options.log =
        std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(log_));
    listener_ = *Listener::Open(options);
    listener_->Start([this](int socket) {
      absl::MutexLock lock(&mutex_);
      taken_.push_back(socket);
    });
  }
  ~ListenerTest() override {
    listener_.reset();
    for (const int socket : taken_) close(socket);
    for (const int socket : connected_) close(socket);
  }

  /// From 127.0.0.`host`.
  int Connect(const std::string& bytes, uint32_t host = 1) {
    const int connected = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl((uint32_t{127} << 24) + host);
    EXPECT_EQ(bind(connected, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    address.sin_port = htons(static_cast<uint16_t>(listener_->port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(connected, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(send(connected, bytes.data(), bytes.size(), MSG_NOSIGNAL), static_cast<ssize_t>(bytes.size()));
    connected_.push_back(connected);
    return connected;
  }
  /// Whether a connection from 127.0.0.`host` comes about, before its first packet would be sent again. It
  /// begins as it should and is closed on this side only, so that it counts as no refusal.
  bool IsAnswered(uint32_t host) {
    const int asking = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl((uint32_t{127} << 24) + host);
    EXPECT_EQ(bind(asking, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    address.sin_port = htons(static_cast<uint16_t>(listener_->port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_TRUE(connect(asking, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0 ||
                errno == EINPROGRESS);
    pollfd answer = {.fd = asking, .events = POLLOUT, .revents = 0};
    constexpr int kBeforeRetransmissionMs = 500;
    const bool is_answered =
        poll(&answer, 1, kBeforeRetransmissionMs) == 1 && (answer.revents & POLLERR) == 0;
    if (is_answered) send(asking, kPreface, sizeof kPreface - 1, MSG_NOSIGNAL);
    close(asking);
    return is_answered;
  }
  /// gRPC's name of our end of a connection.
  static std::string NameOf(int connected) {
    sockaddr_in address = {};
    socklen_t size = sizeof address;
    getsockname(connected, reinterpret_cast<sockaddr*>(&address), &size);
    return absl::StrCat("ipv4:127.0.0.1:", ntohs(address.sin_port));
  }
  /// Waits for the other side to close the connection.
  static bool IsClosed(int connected) {
    char byte = 0;
    return recv(connected, &byte, 1, 0) <= 0;
  }
  void AwaitTaken(size_t count) {
    absl::MutexLock lock(&mutex_);
    const auto reached = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return taken_.size() >= count; };
    mutex_.Await(absl::Condition(&reached));
  }
  /// Closes what was taken, as gRPC does with connections that it ends.
  void EndTaken() {
    absl::MutexLock lock(&mutex_);
    for (const int socket : taken_) close(socket);
    taken_.clear();
  }
  std::string Log() {
    listener_->Stop();
    return log_.str();
  }

  std::ostringstream log_;
  std::unique_ptr<Listener> listener_;
  absl::Mutex mutex_;
  std::vector<int> taken_ ABSL_GUARDED_BY(mutex_);
  std::vector<int> connected_;
};

TEST_F(ListenerTest, HandsOnWhatBeginsAsItShould) {
  Open({});
  Connect(kPreface);
  Connect("P");
  AwaitTaken(2);
  EXPECT_EQ(Log(), "");
}

TEST_F(ListenerTest, ClosesWhatIsNotHttp2) {
  Open({});
  for (const std::string& bytes : {std::string("GET / HTTP/1.1\r\n\r\n"), std::string(1000, '\0'),
                                   std::string("\xff\xfe\xfd"), std::string("SSH-2.0-OpenSSH\r\n")})
    EXPECT_TRUE(IsClosed(Connect(bytes)));
  EXPECT_TRUE(IsClosed(Connect(kClientHello)));
  const std::string log = Log();
  EXPECT_THAT(log, HasSubstr("event=connection_refused address=127.0.0.1 reason=\"not HTTP/2\""));
  EXPECT_THAT(log, HasSubstr("reason=\"TLS, but this port is in plain text\""));
}

TEST_F(ListenerTest, ClosesWhatIsNotTls) {
  Open({.expects_tls = true});
  EXPECT_TRUE(IsClosed(Connect(kPreface)));
  Connect(kClientHello);
  AwaitTaken(1);
  EXPECT_THAT(Log(), HasSubstr("reason=\"not TLS, which this port expects\""));
}

TEST_F(ListenerTest, ClosesWhatIsSilent) {
  Open({.first_bytes = absl::Milliseconds(20)});
  EXPECT_TRUE(IsClosed(Connect("")));
  EXPECT_THAT(Log(), HasSubstr("reason=\"silent for 20ms\""));
}

TEST_F(ListenerTest, AnAddressThatIsShutOutOpensNothingForAWhile) {
  std::atomic<int> seconds = 0;
  Open({}, [&seconds] { return absl::UnixEpoch() + absl::Seconds(seconds.load()); });
  const int kept = Connect(kPreface);
  const int offender = Connect(kPreface);
  AwaitTaken(2);
  listener_->ShutOut(NameOf(offender));
  EXPECT_TRUE(IsClosed(offender));
  EXPECT_FALSE(IsAnswered(1));
  Connect(kPreface, 2);
  AwaitTaken(3);
  seconds = 10;
  while (!IsAnswered(1)) {
  }
  Connect(kPreface);
  AwaitTaken(4);
  char byte = 0;
  EXPECT_EQ(recv(kept, &byte, 1, MSG_DONTWAIT), -1) << "the other connections of the address stay";
  EXPECT_EQ(errno, EAGAIN);
  const std::string log = Log();
  EXPECT_THAT(log, HasSubstr("event=address_shut_out address=127.0.0.1 seconds=10"));
}

TEST_F(ListenerTest, AnAddressThatIsRefusedAgainAndAgainIsShutOut) {
  Open({.refusals_per_second = 1, .refusal_burst = 3}, [] { return absl::UnixEpoch(); });
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(IsClosed(Connect("GET / HTTP/1.1")));
  EXPECT_FALSE(IsAnswered(1));
  EXPECT_TRUE(IsAnswered(2));
  EXPECT_THAT(Log(), HasSubstr("event=address_shut_out address=127.0.0.1 seconds=10"));
}

TEST_F(ListenerTest, AnAddressWhoseConnectionsEndWithoutACallIsShutOut) {
  Open({.refusals_per_second = 1, .refusal_burst = 3});
  std::array<int, 8> called = {};
  for (int& connected : called) connected = Connect(kPreface);
  AwaitTaken(8);  // a call comes on a connection that was handed on, never before
  for (const int connected : called) listener_->NoteCall(NameOf(connected));
  EndTaken();
  EXPECT_TRUE(IsAnswered(1)) << "calls were admitted on these";
  for (int i = 0; i < 8; ++i) Connect(kPreface, 3);
  AwaitTaken(8);
  EndTaken();
  while (IsAnswered(3)) {
  }
  EXPECT_TRUE(IsAnswered(2));
  EXPECT_FALSE(absl::StrContains(Log(), "address_shut_out address=127.0.0.1 "));
}

TEST_F(ListenerTest, TheConnectionsOfAnAddressAreBounded) {
  Open({.connections_per_address = 3});
  for (int i = 0; i < 3; ++i) Connect(kPreface);
  AwaitTaken(3);
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(IsClosed(Connect(kPreface)));
  {
    absl::MutexLock lock(&mutex_);
    ASSERT_EQ(taken_.size(), 3u);
    close(taken_.back());
    taken_.pop_back();
  }
  Connect(kPreface);
  AwaitTaken(3);
  const std::string log = Log();
  EXPECT_THAT(log,
              HasSubstr("reason=\"too many connections: the limits are 3 of an address and 16384 of all\""));
  EXPECT_LT(std::count(log.begin(), log.end(), '\n'), 100) << "a flood must not fill the log";
}

TEST_F(ListenerTest, TheConnectionsOfAllAddressesAreBounded) {
  Open({.connections_per_address = 2, .connections = 3});
  for (const uint32_t host : {1, 1, 2}) Connect(kPreface, host);
  AwaitTaken(3);
  EXPECT_TRUE(IsClosed(Connect(kPreface, 2)));
  EXPECT_TRUE(IsClosed(Connect(kPreface, 3)));
  EXPECT_THAT(Log(),
              HasSubstr("reason=\"too many connections: the limits are 2 of an address and 3 of all\""));
}

TEST_F(ListenerTest, ATakenPortAndAForeignHostAreErrors) {
  Open({});
  for (const std::string& address : {absl::StrCat("127.0.0.1:", listener_->port()),
                                     std::string("192.0.2.1:0"), std::string("no such host:0")}) {
    const absl::Status status = Listener::Open({.address = address}).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable) << address;
    EXPECT_THAT(std::string(status.message()), HasSubstr(address));
  }
}

TEST_F(ListenerTest, StopClosesTheDoor) {
  Open({});
  const int silent = Connect("");
  listener_->Stop();
  EXPECT_TRUE(IsClosed(silent));
  const int late = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(listener_->port()));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(late, reinterpret_cast<sockaddr*>(&address), sizeof address), -1);
  EXPECT_EQ(errno, ECONNREFUSED);
  close(late);
}

}  // namespace
}  // namespace lumifold::server
