#include "server/connection_table.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>
#include <vector>

namespace lumifold::server {
namespace {

sockaddr_storage Ip4(const char* text) {
  sockaddr_storage address = {};
  auto& ip = reinterpret_cast<sockaddr_in&>(address);
  ip.sin_family = AF_INET;
  EXPECT_EQ(inet_pton(AF_INET, text, &ip.sin_addr), 1);
  return address;
}

sockaddr_storage Ip6(const char* text) {
  sockaddr_storage address = {};
  auto& ip = reinterpret_cast<sockaddr_in6&>(address);
  ip.sin6_family = AF_INET6;
  EXPECT_EQ(inet_pton(AF_INET6, text, &ip.sin6_addr), 1);
  return address;
}

int OpenSocket() { return socket(AF_INET, SOCK_STREAM, 0); }

TEST(NetworkOf, IsAnAddressOrANetworkOfIp6) {
  EXPECT_EQ(NetworkOf(Ip4("192.0.2.1")), "192.0.2.1");
  EXPECT_EQ(NetworkOf(Ip6("::ffff:192.0.2.1")), "192.0.2.1");
  EXPECT_EQ(NetworkOf(Ip6("2001:db8:1:2:3:4:5:6")), "2001:db8:1:2::/64");
  EXPECT_EQ(NetworkOf(Ip6("2001:db8:1:2:ffff::1")), "2001:db8:1:2::/64");
}

TEST(ConnectionTable, CountsTheOpenSocketsOfEachNetwork) {
  ConnectionTable table(2, 3);
  std::vector<int> sockets;
  for (int i = 0; i < 5; ++i) sockets.push_back(OpenSocket());
  EXPECT_TRUE(table.Add(sockets[0], "a"));
  EXPECT_TRUE(table.Add(sockets[1], "a"));
  EXPECT_FALSE(table.Add(sockets[2], "a"));
  EXPECT_TRUE(table.Add(sockets[2], "b"));
  EXPECT_FALSE(table.Add(sockets[3], "b")) << "three are all";
  close(sockets[0]);
  EXPECT_TRUE(table.Add(sockets[3], "b")) << "one was closed by its owner";
  table.Remove(sockets[1]);
  EXPECT_TRUE(table.Add(sockets[4], "a"));
  EXPECT_EQ(table.count(), 3);
  for (size_t i = 1; i < sockets.size(); ++i) close(sockets[i]);
}

TEST(ConnectionTable, ADescriptorThatIsUsedAgainIsAnotherConnection) {
  ConnectionTable table(1, 10);
  const int first = OpenSocket();
  EXPECT_TRUE(table.Add(first, "a"));
  close(first);
  const int second = OpenSocket();
  ASSERT_EQ(second, first);
  EXPECT_TRUE(table.Add(second, "b"));
  EXPECT_EQ(table.count(), 1);
  const int third = OpenSocket();
  EXPECT_TRUE(table.Add(third, "a"));
  close(second);
  close(third);
}

}  // namespace
}  // namespace lumifold::server
