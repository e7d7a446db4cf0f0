#pragma once

#include <sys/socket.h>
#include <sys/types.h>

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>

#include "absl/strings/string_view.h"

namespace lumifold::server {

/// "192.0.2.1", or the network of an IPv6 address, "2001:db8::/64": what one caller has.
std::string NetworkOf(const sockaddr_storage& address);

/// The other end of a connection.
struct Peer {
  std::string network;
  uint16_t port = 0;

  friend bool operator<(const Peer& a, const Peer& b) {
    return std::tie(a.network, a.port) < std::tie(b.network, b.port);
  }
};
Peer PeerOf(const sockaddr_storage& address);
/// Of the name that gRPC has for it, such as "ipv4:192.0.2.1:50000"; nullopt for others than those of IP.
std::optional<Peer> PeerOf(absl::string_view name);

/// Tells a socket from an earlier one with the same number; 0 for a descriptor that is closed.
ino_t InodeOf(int socket);

/// The open connections of each network. Who owns a socket does not tell when it closes it, so that those of
/// a network that has reached its limit are looked at: a socket is still the same while its descriptor has
/// the same inode.
/// Threads: one at a time.
class ConnectionTable {
 public:
  ConnectionTable(int per_network, int all) : per_network_(per_network), all_(all) {}

  /// False where the network, or all of them, have too many connections: then the socket is not counted.
  bool Add(int socket, const Peer& peer);
  /// The socket is about to be closed.
  void Remove(int socket);
  /// The open socket of the connection.
  std::optional<int> Find(const Peer& peer) const;

  int count() const { return static_cast<int>(sockets_.size()); }

 private:
  struct Connection {
    ino_t inode = 0;
    Peer peer;
  };

  /// Forgets the connections of the network, or of all, that are closed.
  void Prune(const std::set<int>& sockets);
  int CountOf(const std::string& network) const;

  const int per_network_;
  const int all_;
  std::map<int, Connection> sockets_;
  std::map<std::string, std::set<int>> networks_;
};

}  // namespace lumifold::server
