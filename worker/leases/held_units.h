#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "lumifold/v1/worker.pb.h"
#include "worker/metrics/worker_figures.h"
#include "worker/units/unit_renderer.h"

namespace lumifold::worker {

/// Whether this is the lease of the unit with this attempt.
bool IsLease(const v1::Lease& lease, const v1::UnitId& unit, int64_t attempt);

/// A unit that is held, or in hand. All but `control` is guarded by what guards the HeldUnits.
struct TakenUnit {
  explicit TakenUnit(v1::Lease own) : lease(std::move(own)) {}

  UnitControl control;
  v1::Lease lease;  // the last one that it had
  /// What it is rendered with; null until that is known.
  std::shared_ptr<const v1::JobSpec> spec;
  /// Once it is rendered.
  std::shared_ptr<const RenderedUnit> unit;
  bool has_thread = false;
  bool is_delivered = false;
  bool was_in_hand = false;
};
using TakenPtr = std::shared_ptr<TakenUnit>;

/// The leases that a worker holds, and the units that its threads have taken or that are in hand, as
/// LeaseRunner says.
/// Threads: thread-compatible.
class HeldUnits {
 public:
  explicit HeldUnits(absl::Time now) : idle_since_(now) {}

  const std::vector<v1::Lease>& held() const { return held_; }
  const std::vector<TakenPtr>& in_hand() const { return in_hand_; }
  bool HasWaiting() const { return !waiting_.empty(); }
  /// Since when it holds no lease; InfiniteFuture while it holds one.
  absl::Time IdleSince() const { return held_.empty() ? idle_since_ : absl::InfiniteFuture(); }

  /// Holds a new lease, whose unit waits for a thread; if it is in hand, the lease is its.
  void Add(const v1::Lease& lease);
  /// The unit that has waited longest, which a thread takes with this. HasWaiting() holds.
  TakenPtr TakeWaiting();
  /// Whether a thread has taken the lease's unit, or it was in hand.
  bool IsTaken(const v1::Lease& lease) const { return taken_.contains(lease.attempt()); }
  bool IsDelivered(const v1::Lease& lease) const;
  /// Whether the lease is held and the unit's.
  bool IsCurrent(const v1::Lease& lease, const TakenPtr& taken) const;

  /// Drops all leases: their connection is lost. With `keep`, units that are being rendered, or are rendered,
  /// become units in hand, of which the newest `most` are kept.
  void LoseConnection(bool keep, size_t most);
  /// Forgets a unit in hand, without stopping it.
  void ForgetInHand(const TakenPtr& taken) { std::erase(in_hand_, taken); }
  /// Stops units in hand whose lease meets the condition.
  template <typename Condition>
  void RemoveInHand(Condition condition) {
    std::erase_if(in_hand_, [&](const TakenPtr& taken) {
      if (!condition(taken->lease)) return false;
      Stop(taken);
      return true;
    });
  }
  /// Removes held leases that meet the condition, and stops rendering their units.
  template <typename Condition>
  void RemoveHeld(Condition condition) {
    std::erase_if(waiting_, [&](const TakenPtr& taken) { return condition(taken->lease); });
    const size_t removed = std::erase_if(held_, [&](const v1::Lease& lease) {
      if (!condition(lease)) return false;
      StopTaken(lease);
      return true;
    });
    if (removed > 0) NoteIdle();
  }

  /// The held leases with their progress, and the highest attempt received on this connection.
  void AddTo(v1::Heartbeat* heartbeat) const;
  /// Counts leases and units in hand.
  void AddTo(monitoring::WorkerFigures* figures) const;

 private:
  /// The unit in hand that is the one of the lease, which is not in hand any more; null if there is none.
  TakenPtr TakeInHand(const v1::Lease& lease);
  /// Stops a unit that is not wanted any more.
  void Stop(const TakenPtr& taken);
  /// Stops the unit of a lease that is not held any more, if a thread has taken it.
  void StopTaken(const v1::Lease& lease);
  void NoteIdle();

  std::deque<TakenPtr> waiting_;
  std::vector<v1::Lease> held_;
  absl::Time idle_since_;  // by rpc::MonotonicNow(), while held_ is empty
  /// Held units that a thread has taken or that were in hand, by attempt.
  std::map<int64_t, TakenPtr> taken_;
  /// Units of lost connections, the oldest first. Their attempts may be those of other coordinators.
  std::vector<TakenPtr> in_hand_;
  int64_t past_progress_ = 0;  // sum of those that were removed
  int64_t newest_attempt_ = 0;
};

}  // namespace lumifold::worker
