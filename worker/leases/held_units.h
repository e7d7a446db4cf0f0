#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "lumifold/v1/worker.pb.h"
#include "worker/finish/kept_units.h"
#include "worker/metrics/worker_metrics.h"
#include "worker/units/unit_renderer.h"

namespace lumifold::worker {

/// Whether this is the lease of the unit with this attempt.
bool IsLease(const v1::Lease& lease, const v1::UnitId& unit, int64_t attempt);

/// A unit that a thread has taken.
struct TakenUnit {
  explicit TakenUnit(v1::Lease own) : lease(std::move(own)) {}

  UnitControl control;
  const v1::Lease lease;
  bool is_delivered = false;  // guarded by what guards the HeldUnits
};
using TakenPtr = std::shared_ptr<TakenUnit>;

/// The leases that a worker holds, and the units of them that its threads have taken.
/// Threads: thread-compatible.
class HeldUnits {
 public:
  explicit HeldUnits(absl::Time now) : idle_since_(now) {}

  const std::vector<v1::Lease>& held() const { return held_; }
  bool HasWaiting() const { return !waiting_.empty(); }
  /// Since when it holds no lease; InfiniteFuture while it holds one.
  absl::Time IdleSince() const { return held_.empty() ? idle_since_ : absl::InfiniteFuture(); }

  /// Holds a new lease, whose unit waits for a thread.
  void Add(const v1::Lease& lease);
  /// The unit that has waited longest, which a thread takes with this. HasWaiting() holds.
  TakenPtr TakeWaiting();
  /// Whether a thread has taken the lease's unit.
  bool IsTaken(const v1::Lease& lease) const { return taken_.contains(lease.attempt()); }
  bool IsDelivered(const v1::Lease& lease) const;
  /// Whether the unit's lease is still held.
  bool IsHeld(const TakenPtr& taken) const;

  /// Records of units whose leases have ended well.
  KeptUnits& kept() { return kept_; }
  /// Removes all leases and records, and stops rendering units: their connection is lost.
  void LoseConnection();
  /// Removes held leases that meet the condition, and stops rendering their units.
  template <typename Condition>
  void RemoveHeld(Condition condition) {
    std::erase_if(waiting_, condition);
    const size_t removed = std::erase_if(held_, [&](const v1::Lease& lease) {
      if (!condition(lease)) return false;
      StopTaken(lease);
      return true;
    });
    if (removed > 0) NoteIdle();
  }

  /// The held leases with their progress, and the highest attempt received on this connection.
  void AddTo(v1::Heartbeat* heartbeat) const;
  /// Counts leases.
  void AddTo(monitoring::WorkerMetrics* metrics) const;

 private:
  /// Stops the unit of a lease that is not held any more, if a thread has taken it.
  void StopTaken(const v1::Lease& lease);
  void NoteIdle();

  std::deque<v1::Lease> waiting_;
  std::vector<v1::Lease> held_;
  KeptUnits kept_;
  absl::Time idle_since_;              // by rpc::MonotonicNow(), while held_ is empty
  std::map<int64_t, TakenPtr> taken_;  // those that are held, by attempt
  int64_t past_progress_ = 0;          // sum of those that were removed
  int64_t newest_attempt_ = 0;
};

}  // namespace lumifold::worker
