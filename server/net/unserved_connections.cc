#include "server/net/unserved_connections.h"

#include <utility>

namespace lumifold::server {

void UnservedConnections::Add(int socket, const Peer& peer) {
  absl::MutexLock lock(&mutex_);
  const auto [place, is_new] = sockets_.try_emplace(socket);
  if (!is_new && peers_.erase(place->second.peer) > 0) replaced_.push_back(place->second.peer.network);
  place->second = {InodeOf(socket), peer};
  peers_.insert(peer);
}

void UnservedConnections::NoteCall(const Peer& peer) {
  absl::MutexLock lock(&mutex_);
  peers_.erase(peer);
}

std::vector<std::string> UnservedConnections::TakeEnded() {
  std::vector<std::string> networks = std::exchange(replaced_, {});
  absl::MutexLock lock(&mutex_);
  for (auto place = sockets_.begin(); place != sockets_.end();) {
    const Connection& connection = place->second;
    const bool is_served = !peers_.contains(connection.peer);
    const bool is_open = InodeOf(place->first) == connection.inode;
    if (!is_served && is_open) {
      ++place;
      continue;
    }
    if (!is_served) {
      networks.push_back(connection.peer.network);
      peers_.erase(connection.peer);
    }
    place = sockets_.erase(place);
  }
  return networks;
}

}  // namespace lumifold::server
