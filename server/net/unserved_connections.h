#pragma once

#include <sys/types.h>

#include <map>
#include <set>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/net/connection_table.h"

namespace lumifold::server {

/// The connections that were handed on, of which no call was admitted yet. One that ends so was of no use,
/// whatever the reason: a broken frame, a message too large, a handshake that fails. gRPC ends those itself
/// and tells nobody.
/// Threads: NoteCall any, the others one at a time.
class UnservedConnections {
 public:
  /// The socket is about to be handed on.
  void Add(int socket, const Peer& peer);
  /// A call of the connection was admitted.
  void NoteCall(const Peer& peer);
  /// The networks of those that are closed, once for each connection; forgets them.
  std::vector<std::string> TakeEnded();

 private:
  struct Connection {
    ino_t inode = 0;
    Peer peer;
  };

  std::map<int, Connection> sockets_;
  std::vector<std::string> replaced_;  // networks of those whose socket's number was given to another
  absl::Mutex mutex_;
  std::set<Peer> peers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::server
