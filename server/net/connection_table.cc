#include "server/net/connection_table.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "absl/strings/numbers.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"

namespace lumifold::server {
namespace {

std::string TextOf(int family, const void* address) {
  std::array<char, INET6_ADDRSTRLEN> text = {};
  return inet_ntop(family, address, text.data(), text.size()) == nullptr ? "" : text.data();
}

}  // namespace

ino_t InodeOf(int socket) {
  struct stat info = {};
  return fstat(socket, &info) == 0 ? info.st_ino : 0;
}

std::string NetworkOf(const sockaddr_storage& address) {
  if (address.ss_family == AF_INET)
    return TextOf(AF_INET, &reinterpret_cast<const sockaddr_in&>(address).sin_addr);
  if (address.ss_family != AF_INET6) return "";
  in6_addr ip = reinterpret_cast<const sockaddr_in6&>(address).sin6_addr;
  if (IN6_IS_ADDR_V4MAPPED(&ip)) return TextOf(AF_INET, ip.s6_addr + 12);
  std::memset(ip.s6_addr + 8, 0, 8);
  return TextOf(AF_INET6, &ip) + "/64";
}

Peer PeerOf(const sockaddr_storage& address) {
  // The port is at the same place in both families.
  const in_port_t port = address.ss_family == AF_INET
                             ? reinterpret_cast<const sockaddr_in&>(address).sin_port
                             : reinterpret_cast<const sockaddr_in6&>(address).sin6_port;
  return {NetworkOf(address), ntohs(port)};
}

std::optional<Peer> PeerOf(absl::string_view name) {
  const bool is_ip4 = absl::ConsumePrefix(&name, "ipv4:");
  if (!is_ip4 && !absl::ConsumePrefix(&name, "ipv6:")) return std::nullopt;
  const size_t colon = name.rfind(':');
  uint32_t port = 0;
  if (colon == name.npos || !absl::SimpleAtoi(name.substr(colon + 1), &port) || port > UINT16_MAX)
    return std::nullopt;
  // gRPC writes "%5B::1%5D:50000", and "%25" before the name of an interface.
  std::string host =
      absl::StrReplaceAll(name.substr(0, colon), {{"%5B", ""}, {"%5D", ""}, {"[", ""}, {"]", ""}});
  host = host.substr(0, host.find('%'));
  sockaddr_storage address = {};
  address.ss_family = is_ip4 ? AF_INET : AF_INET6;
  void* const ip = is_ip4 ? static_cast<void*>(&reinterpret_cast<sockaddr_in&>(address).sin_addr)
                          : &reinterpret_cast<sockaddr_in6&>(address).sin6_addr;
  if (inet_pton(address.ss_family, host.c_str(), ip) != 1) return std::nullopt;
  return Peer{NetworkOf(address), static_cast<uint16_t>(port)};
}

int ConnectionTable::CountOf(const std::string& network) const {
  const auto found = networks_.find(network);
  return found == networks_.end() ? 0 : static_cast<int>(found->second.size());
}

bool ConnectionTable::Add(int socket, const Peer& peer) {
  const std::string& network = peer.network;
  Remove(socket);  // the number is free again, so its connection was closed
  if (CountOf(network) >= per_network_) Prune(std::set<int>(networks_.at(network)));
  if (count() >= all_) {
    std::set<int> all;
    for (const auto& [other, connection] : sockets_) all.insert(other);
    Prune(all);
  }
  if (CountOf(network) >= per_network_ || count() >= all_) return false;
  sockets_[socket] = {InodeOf(socket), peer};
  networks_[network].insert(socket);
  return true;
}

void ConnectionTable::Remove(int socket) {
  const auto found = sockets_.find(socket);
  if (found == sockets_.end()) return;
  const auto network = networks_.find(found->second.peer.network);
  network->second.erase(socket);
  if (network->second.empty()) networks_.erase(network);
  sockets_.erase(found);
}

std::optional<int> ConnectionTable::Find(const Peer& peer) const {
  const auto network = networks_.find(peer.network);
  if (network == networks_.end()) return std::nullopt;
  for (const int socket : network->second) {
    const Connection& connection = sockets_.at(socket);
    if (connection.peer.port == peer.port && connection.inode == InodeOf(socket)) return socket;
  }
  return std::nullopt;
}

void ConnectionTable::Prune(const std::set<int>& sockets) {
  for (const int socket : sockets) {
    if (InodeOf(socket) != sockets_.at(socket).inode) Remove(socket);
  }
}

}  // namespace lumifold::server
