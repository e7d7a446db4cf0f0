#include "proto/service/service_manager.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <string>

#include "tests/support/temp_folder.h"

namespace lumifold::service {
namespace {

/// A service manager's socket, named by the environment.
class ServiceManagerTest : public ::testing::Test {
 protected:
  void Listen(const std::string& limit_us) {
    const std::string path = folder_.PathOf("notify");
    sockaddr_un address = {};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path.c_str(), sizeof(address.sun_path) - 1);
    socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    ASSERT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
    if (!limit_us.empty()) setenv("WATCHDOG_USEC", limit_us.c_str(), 1);
  }
  void TearDown() override {
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
    if (socket_ >= 0) close(socket_);
  }

  /// The next message; empty where there is none.
  std::string Received() const {
    std::array<char, 256> text = {};
    const ssize_t size = recv(socket_, text.data(), text.size(), 0);
    return size > 0 ? std::string(text.data(), static_cast<size_t>(size)) : "";
  }

 private:
  TempFolder folder_;
  int socket_ = -1;
};

TEST_F(ServiceManagerTest, TellsWhatTheProgramDoes) {
  Listen("");
  ServiceManager manager;
  manager.Ready("listening on 127.0.0.1:7700\nREADY=0");
  EXPECT_EQ(Received(), "READY=1\nSTATUS=listening on 127.0.0.1:7700 READY=0");
  manager.Stopping();
  EXPECT_EQ(Received(), "STOPPING=1");
}

TEST_F(ServiceManagerTest, SignsOfLifeAreSentWhereSomebodyWaitsForThem) {
  Listen("");
  ServiceManager silent;
  EXPECT_EQ(silent.alive_interval(), absl::InfiniteDuration());
  silent.Alive();
  EXPECT_EQ(Received(), "");
}

TEST_F(ServiceManagerTest, SignsOfLifeAreSentNoMoreOftenThanNeeded) {
  Listen("3600000000");
  ServiceManager manager;
  EXPECT_EQ(manager.alive_interval(), absl::Minutes(15));
  for (int i = 0; i < 3; ++i) manager.Alive();
  EXPECT_EQ(Received(), "WATCHDOG=1");
  EXPECT_EQ(Received(), "");
}

TEST(ServiceManager, WithoutOneNothingIsTold) {
  ServiceManager manager;
  manager.Ready("");
  manager.Alive();
  manager.Stopping();
}

}  // namespace
}  // namespace lumifold::service
