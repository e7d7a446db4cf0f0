#include "server/page/connection.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <string>

#include "proto/rpc/monotonic.h"

namespace lumifold::page {
namespace {

class ConnectionTest : public ::testing::Test {
 protected:
  ConnectionTest() { EXPECT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, sockets_.data()), 0); }
  ~ConnectionTest() override {
    for (const int socket : sockets_) close(socket);
  }
  void Send(const std::string& bytes) {
    EXPECT_EQ(write(sockets_[1], bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  std::string Read(Connection* connection, size_t size) {
    std::string bytes(size, '\0');
    const ssize_t got = connection->read(bytes.data(), size);
    bytes.resize(static_cast<size_t>(std::max<ssize_t>(got, 0)));
    return got < 0 ? "error" : bytes;
  }

  std::array<int, 2> sockets_ = {};
};

TEST_F(ConnectionTest, ReadsWhatComesInPieces) {
  Connection connection(sockets_[0], nullptr);
  connection.SetReadDeadline(absl::InfiniteFuture());
  Send("abcdef");
  EXPECT_EQ(Read(&connection, 2), "ab");
  EXPECT_TRUE(connection.WaitForRequest(absl::InfinitePast())) << "there is more";
  EXPECT_EQ(Read(&connection, 10), "cdef");
  EXPECT_FALSE(connection.WaitForRequest(absl::InfinitePast()));
  shutdown(sockets_[1], SHUT_WR);
  EXPECT_EQ(Read(&connection, 1), "") << "the end";
}

TEST_F(ConnectionTest, AByteNowAndThenDoesNotMoveTheDeadline) {
  Connection connection(sockets_[0], nullptr);
  connection.SetReadDeadline(rpc::MonotonicNow() + absl::Milliseconds(50));
  Send("a");
  EXPECT_EQ(Read(&connection, 1), "a");
  EXPECT_EQ(Read(&connection, 1), "error") << "nothing came until the deadline";
  Send("b");
  connection.SetReadDeadline(absl::InfinitePast());
  EXPECT_EQ(Read(&connection, 1), "b") << "what is there is read";
  EXPECT_EQ(Read(&connection, 1), "error");
}

TEST_F(ConnectionTest, WritesAllOfIt) {
  Connection connection(sockets_[0], nullptr);
  EXPECT_EQ(connection.write("hello", 5), 5);
  std::array<char, 8> bytes = {};
  EXPECT_EQ(read(sockets_[1], bytes.data(), bytes.size()), 5);
  close(sockets_[1]);
  sockets_[1] = open("/dev/null", O_RDONLY);
  EXPECT_EQ(connection.write("hello", 5), -1) << "nobody is there";
}

}  // namespace
}  // namespace lumifold::page
