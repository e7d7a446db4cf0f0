#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "server/assets/asset_store.h"

namespace lumifold::server {

/// Reads assets that have not been checked since the start (see AssetStore) on threads of its own, the
/// smallest first, so that the check of a large one, which takes about 0.6 s for each GB, delays no call that
/// does not need it.
/// Threads: safe.
class AssetChecks {
 public:
  /// With kUnavailable when Stop has prevented the check.
  using Done = std::function<void(const absl::Status&)>;

  /// `assets` must outlive it.
  explicit AssetChecks(AssetStore* assets);
  /// Calls Stop.
  ~AssetChecks();

  /// Calls `done` once AssetStore::Has answers for all of these without reading a file: at once if it already
  /// does, otherwise from another thread. Text that is not a SHA-256 needs no check.
  void Check(const std::set<std::string>& sha256, Done done);
  /// The same for an asset whose content is in doubt: it is read again.
  void Recheck(const std::string& sha256, Done done);

  /// Ends checks in progress and calls what waits for them. Later calls end at once.
  void Stop();

 private:
  /// A call that waits for several assets.
  struct Waiter {
    size_t unchecked = 0;
    Done done;
  };

  void Run();
  bool HasWork() const ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return stopping_ || !queue_.empty(); }
  /// The waiters that wait for no other asset, once this one is checked.
  std::vector<std::shared_ptr<Waiter>> TakeReady(const std::string& sha256)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  AssetStore* const assets_;
  absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::set<std::pair<uint64_t, std::string>> queue_ ABSL_GUARDED_BY(mutex_);  // by size
  /// Of assets in the queue, and of those that are being read.
  std::map<std::string, std::vector<std::shared_ptr<Waiter>>> waiters_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::thread> threads_;
};

}  // namespace lumifold::server
