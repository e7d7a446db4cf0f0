#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/worker.pb.h"
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
/// units on its threads and sends the results. Leases belong to a connection: when it is lost they are void,
/// and units still being rendered for it are dropped.
/// Threads: all calls are safe concurrently.
class WorkerImpl {
 public:
  /// `renderer` must outlive it. threads >= 1. `log` must not be null.
  WorkerImpl(int threads, UnitRenderer* renderer, std::shared_ptr<spdlog::logger> log);
  /// Waits for the units being rendered.
  ~WorkerImpl();

  /// Number of leases to hold: for each thread one that is being rendered and one that waits, so that no
  /// thread is idle during a round trip.
  int slots() const { return 2 * static_cast<int>(threads_.size()); }

  /// A connection is open; messages go to `outbox` until OnDisconnected().
  void OnConnected(std::shared_ptr<Outbox> outbox);
  void OnDisconnected();

  /// Handles a message of the coordinator.
  void OnMessage(const v1::CoordinatorMessage& message);

  /// A heartbeat with the leases that are not acknowledged, their progress, and the highest attempt received.
  v1::Heartbeat MakeHeartbeat() const;

 private:
  void RunThread();
  bool HasWorkOrStops() const ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return stopping_ || !waiting_.empty(); }
  void OnGrant(const v1::Grant& grant) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnAck(const v1::UnitAck& ack) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnJobEnded(const std::string& job_id) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Renders the unit of a lease and sends it if the connection that granted the lease is still open.
  void RenderAndSend(const v1::Lease& lease, const v1::JobSpec& spec, const std::shared_ptr<Outbox>& outbox,
                     std::atomic<int64_t>* progress);
  void Forget(const v1::Lease& lease);
  /// Removes held leases that meet the condition.
  template <typename Condition>
  void RemoveHeld(Condition condition) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool IsCurrent(const v1::Lease& lease, const std::shared_ptr<Outbox>& outbox) const;

  UnitRenderer* const renderer_;
  const std::shared_ptr<spdlog::logger> log_;
  std::vector<std::thread> threads_;

  mutable absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::shared_ptr<Outbox> outbox_ ABSL_GUARDED_BY(mutex_);
  std::deque<v1::Lease> waiting_ ABSL_GUARDED_BY(mutex_);
  std::vector<v1::Lease> held_ ABSL_GUARDED_BY(mutex_);
  /// Progress of the held leases that a thread has taken, by attempt.
  std::map<int64_t, std::shared_ptr<std::atomic<int64_t>>> progress_ ABSL_GUARDED_BY(mutex_);
  int64_t past_progress_ ABSL_GUARDED_BY(mutex_) = 0;  // sum of those that were removed
  int64_t newest_attempt_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<std::string, std::shared_ptr<const v1::JobSpec>> specs_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::worker
