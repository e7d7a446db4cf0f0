#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/worker.pb.h"
#include "worker/cache/spec_cache.h"
#include "worker/finish/finish_frame.h"
#include "worker/leases/held_units.h"
#include "worker/leases/thread_account.h"
#include "worker/leases/thread_activities.h"
#include "worker/leases/worker_log.h"
#include "worker/metrics/worker_metrics.h"
#include "worker/units/unit_renderer.h"

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
/// A worker leaves in these steps: Leave() tells the coordinator and hands back the leases that wait for a
/// thread; units that are being rendered are delivered, or handed back by HandBackUnfinished(); HasLeft() is
/// true once the coordinator has answered that no grant is under way, and every lease is acknowledged or
/// handed back. No unit is lost by it. It moves to another coordinator in the same steps, but the coordinator
/// grants nothing after v1::Move. One that moves at once does not wait: its leases are void.
/// Threads: all calls are safe concurrently.
class LeaseRunner {
 public:
  /// `specs`, `renderer` and the link of `frames` must outlive it. threads >= 1.
  LeaseRunner(int threads, SpecCache* specs, UnitRenderer* renderer, WorkerLog log, FrameWork frames = {});
  /// Waits for its threads, which end at the next row of pixels or file of a scene.
  ~LeaseRunner();

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

  /// Begins to leave, for this reason (see v1::Leaving). Later calls only end the patience of a drain.
  void Leave(const std::string& reason);
  /// Whether an operator wants it to leave after its units, however long they take.
  bool FinishesUnits() const;
  /// Takes no leases for now, and hands back those that wait for a thread; an empty reason: takes them again.
  /// To be called again on each connection.
  void Rest(const std::string& reason);
  bool IsLeaving() const;
  bool IsMoving() const;
  /// The address to move to, if the coordinator has sent one, or an empty text for any other; it is forgotten
  /// here.
  std::optional<std::string> TakeMove();
  /// Hands back the leases whose units are not delivered.
  void HandBackUnfinished();
  /// Whether nothing remains to be done on this connection by a worker that leaves or moves.
  bool HasLeft() const;

  /// Since when it holds no lease, by rpc::MonotonicNow(); InfiniteFuture while it holds one.
  absl::Time IdleSince() const;

  /// Its leases, units and threads; what is none of them is zero.
  monitoring::WorkerMetrics Metrics() const;

 private:
  /// How far it is with leaving or moving.
  struct LeaveState {
    bool leaving = false;
    bool released = false;  // the coordinator has answered: no grant is under way
    bool finishes_units = false;
    std::optional<v1::Move> move;
  };

  void RunThread();
  void LogAccount(const std::string& job_id, absl::Duration spent) const;
  bool HasWorkOrStops() const ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return stopping_ || units_.HasWaiting(); }
  void OnGrant(const v1::Grant& grant) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnAck(const v1::UnitAck& ack) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnVoidLeases(const v1::VoidLeases& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnJobEnded(const std::string& job_id) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnMove(const v1::Move& move) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnDrain(const v1::Drain& drain) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void BeginToLeave(const std::string& reason) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  /// Renders a unit, or finishes a frame, and delivers it; a second time where memory was short.
  void Work(const TakenPtr& taken);
  absl::Status Try(const TakenPtr& taken);
  absl::Status TryUnguarded(const TakenPtr& taken);
  absl::Status Finish(const TakenPtr& taken, const v1::JobSpec& spec);
  /// Hands back the leases of a job that no thread has taken.
  void HandBackJob(const std::string& job_id);
  /// Rendering has failed. Reports it, unless the lease is void: then the failure may come of that.
  void Fail(const TakenPtr& taken, const absl::Status& failure);
  /// The job of the unit has ended, and the message that says so is on its way.
  void EndJobOf(const TakenPtr& taken);
  /// Delivers a rendered unit, or keeps its record, unless the lease is void.
  absl::Status Deliver(const TakenPtr& taken, const v1::JobSpec& spec, const RenderedUnit& unit);
  absl::Status Keep(const TakenPtr& taken, const v1::JobSpec& spec, const RenderedUnit& unit);
  void Send(const TakenPtr& taken, const RenderedUnit& unit);

  /// Removes held leases that meet the condition, and hands them back.
  template <typename Condition>
  void HandBack(Condition condition) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Hands back the leases that no thread has taken.
  void HandBackWaiting() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  SpecCache* const specs_;
  UnitRenderer* const renderer_;
  const FrameWork frames_;
  const WorkerLog log_;
  const uint64_t instance_;
  std::vector<std::thread> threads_;
  ThreadAccount account_;
  mutable ThreadActivities activities_;

  mutable absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  LeaveState leave_ ABSL_GUARDED_BY(mutex_);
  std::string rest_ ABSL_GUARDED_BY(mutex_);  // as the coordinator knows it
  std::shared_ptr<Outbox> outbox_ ABSL_GUARDED_BY(mutex_);
  HeldUnits units_ ABSL_GUARDED_BY(mutex_);
  monitoring::WorkerMetrics totals_ ABSL_GUARDED_BY(mutex_);  // what only grows
};

}  // namespace lumifold::worker
