#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/worker.pb.h"
#include "worker/spec_cache.h"
#include "worker/unit_renderer.h"

namespace spdlog {
class logger;
}

namespace lumifold::worker {

/// Queue of messages to the coordinator.
/// Threads: implementations are safe concurrently and never block.
class Outbox {
 public:
  virtual ~Outbox() = default;
  virtual void Send(v1::WorkerMessage message) = 0;
};

/// The worker's side of the protocol, independent of the network: handles the coordinator's messages, renders
/// units on its threads and sends the results. Leases belong to a connection: when it is lost they are void.
/// A unit whose lease is void is no longer rendered.
///
/// A worker leaves in these steps: Leave() tells the coordinator and hands back the leases that wait for a thread;
/// units that are being rendered are delivered, or handed back by HandBackUnfinished(); HasLeft() is true once the
/// coordinator has answered that no grant is under way, and every lease is acknowledged or handed back. No unit is
/// lost by it.
/// Threads: all calls are safe concurrently.
class WorkerImpl {
 public:
  /// `specs` and `renderer` must outlive it. threads >= 1. `log` must not be null.
  WorkerImpl(int threads, SpecCache* specs, UnitRenderer* renderer, std::shared_ptr<spdlog::logger> log);
  /// Waits for its threads, which end at the next row of pixels or file of a scene.
  ~WorkerImpl();

  /// Number of leases to hold: for each thread one that is being rendered and one that waits, so that no
  /// thread is idle during a round trip.
  int slots() const { return 2 * static_cast<int>(threads_.size()); }

  /// See v1::Hello.
  uint64_t instance() const { return instance_; }

  /// A connection is open; messages go to `outbox` until OnDisconnected().
  void OnConnected(std::shared_ptr<Outbox> outbox);
  void OnDisconnected();

  /// Handles a message of the coordinator.
  void OnMessage(const v1::CoordinatorMessage& message);

  /// A heartbeat with the leases that are not acknowledged, their progress, and the highest attempt received.
  v1::Heartbeat MakeHeartbeat() const;

  /// Begins to leave, for this reason (see v1::Leaving). Later calls have no effect.
  void Leave(const std::string& reason);
  bool IsLeaving() const;
  /// Hands back the leases whose units are not delivered.
  void HandBackUnfinished();
  bool HasLeft() const;

  /// Since when it holds no lease, by rpc::MonotonicNow(); InfiniteFuture while it holds one.
  absl::Time IdleSince() const;

 private:
  /// A held lease that a thread has taken.
  struct Taken {
    UnitControl control;
    bool is_delivered = false;  // guarded by mutex_
  };

  void RunThread();
  bool HasWorkOrStops() const ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return stopping_ || !waiting_.empty(); }
  void OnGrant(const v1::Grant& grant) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnAck(const v1::UnitAck& ack) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnVoidLeases(const v1::VoidLeases& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnJobEnded(const std::string& job_id) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void BeginToLeave(const std::string& reason) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<RenderedUnit> Render(const v1::Lease& lease, UnitControl* control);
  /// Renders the unit of a lease and sends it, if the lease is still valid.
  void RenderAndSend(const v1::Lease& lease, Taken* taken);
  /// The outbox for the result of a lease, which counts as delivered from now on; null if the lease is void.
  std::shared_ptr<Outbox> BeginDelivery(const v1::Lease& lease, Taken* taken);
  /// Removes held leases that meet the condition, and stops rendering their units.
  template <typename Condition>
  void RemoveHeld(Condition condition) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Removes held leases that meet the condition, and hands them back.
  template <typename Condition>
  void HandBack(Condition condition) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Hands back the leases that no thread has taken.
  void HandBackWaiting() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  SpecCache* const specs_;
  UnitRenderer* const renderer_;
  const std::shared_ptr<spdlog::logger> log_;
  const uint64_t instance_;
  std::vector<std::thread> threads_;

  mutable absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  bool leaving_ ABSL_GUARDED_BY(mutex_) = false;
  bool released_ ABSL_GUARDED_BY(mutex_) = false;
  std::shared_ptr<Outbox> outbox_ ABSL_GUARDED_BY(mutex_);
  std::deque<v1::Lease> waiting_ ABSL_GUARDED_BY(mutex_);
  std::vector<v1::Lease> held_ ABSL_GUARDED_BY(mutex_);
  absl::Time idle_since_ ABSL_GUARDED_BY(mutex_);  // while held_ is empty
  /// By attempt.
  std::map<int64_t, std::shared_ptr<Taken>> taken_ ABSL_GUARDED_BY(mutex_);
  int64_t past_progress_ ABSL_GUARDED_BY(mutex_) = 0;  // sum of those that were removed
  int64_t newest_attempt_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace lumifold::worker
