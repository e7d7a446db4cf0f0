#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <optional>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "proto/threads/event.h"
#include "server/commit/accepted_unit.h"

namespace lumifold::server {

/// What waits for the committer: orders, which go first, and units.
/// Threads: safe; Await, Pause and what takes something out from the committer's thread.
class CommitQueue {
 public:
  struct Order {
    std::function<absl::Status()> write;
    std::function<void(const absl::Status&)> done;
  };

  // No effect after Stop.
  void Add(AcceptedUnit unit);
  void Add(Order order);
  /// Others have noticed that the storage cannot be written.
  void NoteStorageFailure();
  void Stop();
  bool is_stopping() const;

  enum class Work { kWaits, kStorageFailed, kEnded };
  /// Waits until there is something to do. kStorageFailed is told once. kEnded: it is stopped and empty.
  Work Await();
  /// Waits until `end` by the clock `now`, or a new order, or Stop.
  void Pause(absl::Time end, const std::function<absl::Time()>& now);

  /// The order that is to be carried out next; it stays until PopOrder.
  std::optional<Order> FirstOrder();
  void PopOrder();
  std::vector<AcceptedUnit> TakeUnits(size_t count);
  void DropUnits(const job::JobId& job);

 private:
  bool HasWork() const ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
    return stopping_ || storage_failed_ || !orders_.empty() || !units_.empty();
  }
  bool EndsPause() const;

  mutable absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<Order> orders_ ABSL_GUARDED_BY(mutex_);
  std::deque<AcceptedUnit> units_ ABSL_GUARDED_BY(mutex_);
  bool has_new_order_ ABSL_GUARDED_BY(mutex_) = false;
  bool storage_failed_ ABSL_GUARDED_BY(mutex_) = false;
  threads::Event wake_up_;
};

}  // namespace lumifold::server
