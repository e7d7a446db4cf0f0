#include "server/connection_table.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace lumifold::server {
namespace {

/// 0 for a descriptor that is closed.
ino_t InodeOf(int socket) {
  struct stat info = {};
  return fstat(socket, &info) == 0 ? info.st_ino : 0;
}

std::string TextOf(int family, const void* address) {
  std::array<char, INET6_ADDRSTRLEN> text = {};
  return inet_ntop(family, address, text.data(), text.size()) == nullptr ? "" : text.data();
}

}  // namespace

std::string NetworkOf(const sockaddr_storage& address) {
  if (address.ss_family == AF_INET)
    return TextOf(AF_INET, &reinterpret_cast<const sockaddr_in&>(address).sin_addr);
  if (address.ss_family != AF_INET6) return "";
  in6_addr ip = reinterpret_cast<const sockaddr_in6&>(address).sin6_addr;
  if (IN6_IS_ADDR_V4MAPPED(&ip)) return TextOf(AF_INET, ip.s6_addr + 12);
  std::memset(ip.s6_addr + 8, 0, 8);
  return TextOf(AF_INET6, &ip) + "/64";
}

int ConnectionTable::CountOf(const std::string& network) const {
  const auto found = networks_.find(network);
  return found == networks_.end() ? 0 : static_cast<int>(found->second.size());
}

bool ConnectionTable::Add(int socket, const std::string& network) {
  Remove(socket);  // the number is free again, so its connection was closed
  if (CountOf(network) >= per_network_) Prune(std::set<int>(networks_.at(network)));
  if (count() >= all_) {
    std::set<int> all;
    for (const auto& [other, connection] : sockets_) all.insert(other);
    Prune(all);
  }
  if (CountOf(network) >= per_network_ || count() >= all_) return false;
  sockets_[socket] = {InodeOf(socket), network};
  networks_[network].insert(socket);
  return true;
}

void ConnectionTable::Remove(int socket) {
  const auto found = sockets_.find(socket);
  if (found == sockets_.end()) return;
  const auto network = networks_.find(found->second.network);
  network->second.erase(socket);
  if (network->second.empty()) networks_.erase(network);
  sockets_.erase(found);
}

void ConnectionTable::Prune(const std::set<int>& sockets) {
  for (const int socket : sockets) {
    if (InodeOf(socket) != sockets_.at(socket).inode) Remove(socket);
  }
}

}  // namespace lumifold::server
