#include "server/net/connection_table.h"

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

TEST(PeerOf, ReadsTheNamesOfGrpc) {
  const std::optional<Peer> ip4 = PeerOf("ipv4:192.0.2.1:50000");
  ASSERT_TRUE(ip4.has_value());
  EXPECT_EQ(ip4->network, "192.0.2.1");
  EXPECT_EQ(ip4->port, 50000);
  for (const char* name : {"ipv6:%5B2001:db8:1:2::9%5D:443", "ipv6:[2001:db8:1:2::9]:443"}) {
    const std::optional<Peer> ip6 = PeerOf(name);
    ASSERT_TRUE(ip6.has_value()) << name;
    EXPECT_EQ(ip6->network, "2001:db8:1:2::/64");
    EXPECT_EQ(ip6->port, 443);
  }
  EXPECT_EQ(PeerOf("ipv6:%5Bfe80::1%25eth0%5D:1")->network, "fe80::/64");
  for (const char* name :
       {"", "unix:/run/socket", "ipv4:192.0.2.1", "ipv4:192.0.2.1:65536", "ipv4:x:1", "ipv6:::"})
    EXPECT_FALSE(PeerOf(name).has_value()) << name;
}

TEST(ConnectionTable, FindsTheOpenSocketOfAPeer) {
  ConnectionTable table(10, 10);
  const int socket = OpenSocket();
  EXPECT_TRUE(table.Add(socket, Peer{"a", 1}));
  EXPECT_EQ(table.Find({"a", 1}), socket);
  EXPECT_EQ(table.Find({"a", 2}), std::nullopt);
  EXPECT_EQ(table.Find({"b", 1}), std::nullopt);
  close(socket);
  EXPECT_EQ(table.Find({"a", 1}), std::nullopt);
}

TEST(ConnectionTable, CountsTheOpenSocketsOfEachNetwork) {
  ConnectionTable table(2, 3);
  std::vector<int> sockets;
  for (int i = 0; i < 5; ++i) sockets.push_back(OpenSocket());
  EXPECT_TRUE(table.Add(sockets[0], Peer{"a"}));
  EXPECT_TRUE(table.Add(sockets[1], Peer{"a"}));
  EXPECT_FALSE(table.Add(sockets[2], Peer{"a"}));
  EXPECT_TRUE(table.Add(sockets[2], Peer{"b"}));
  EXPECT_FALSE(table.Add(sockets[3], Peer{"b"})) << "three are all";
  close(sockets[0]);
  EXPECT_TRUE(table.Add(sockets[3], Peer{"b"})) << "one was closed by its owner";
  table.Remove(sockets[1]);
  EXPECT_TRUE(table.Add(sockets[4], Peer{"a"}));
  EXPECT_EQ(table.count(), 3);
  for (size_t i = 1; i < sockets.size(); ++i) close(sockets[i]);
}

TEST(ConnectionTable, ADescriptorThatIsUsedAgainIsAnotherConnection) {
  ConnectionTable table(1, 10);
  const int first = OpenSocket();
  EXPECT_TRUE(table.Add(first, Peer{"a"}));
  close(first);
  const int second = OpenSocket();
  ASSERT_EQ(second, first);
  EXPECT_TRUE(table.Add(second, Peer{"b"}));
  EXPECT_EQ(table.count(), 1);
  const int third = OpenSocket();
  EXPECT_TRUE(table.Add(third, Peer{"a"}));
  close(second);
  close(third);
}

}  // namespace
}  // namespace lumifold::server
