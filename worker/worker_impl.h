#pragma once

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

/// What a worker says to the coordinator goes in here. Threads: implementations are safe concurrently and
/// never wait.
class Outbox {
 public:
  virtual ~Outbox() = default;
  virtual void Send(v1::WorkerMessage message) = 0;
};

/// The worker's part of the protocol, without a network: takes what the coordinator says, renders on its
/// threads, and says what comes of it. Leases belong to a connection: when it is lost they are void, and
/// whatever is still being rendered for it is dropped. Threads: all calls are safe concurrently.
class WorkerImpl {
 public:
  /// `renderer` must outlive it. threads >= 1. Events go to `log`, which must not be null.
  WorkerImpl(int threads, UnitRenderer* renderer, std::shared_ptr<spdlog::logger> log);
  /// Waits for the units being rendered.
  ~WorkerImpl();

  /// Leases a worker of this size wants: one rendering and one waiting a thread, so that none stands idle
  /// while an answer travels.
  int slots() const { return 2 * static_cast<int>(threads_.size()); }

  /// A connection has begun; what is to be said goes to `outbox` until OnDisconnected().
  void OnConnected(std::shared_ptr<Outbox> outbox);
  void OnDisconnected();

  /// The coordinator said something.
  void OnMessage(const v1::CoordinatorMessage& message);

  /// What a heartbeat says now: the leases not yet acknowledged, and how far the grants seen so far reach.
  v1::Heartbeat MakeHeartbeat() const;

 private:
  void RunThread();
  bool HasWorkOrStops() const ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return stopping_ || !waiting_.empty(); }
  void OnGrant(const v1::Grant& grant) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnAck(const v1::UnitAck& ack) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void OnJobEnded(const std::string& job_id) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Renders one lease and sends what comes of it, if the connection it came by still stands.
  void RenderAndSend(const v1::Lease& lease, const v1::JobSpec& spec, const std::shared_ptr<Outbox>& outbox);
  void Forget(const v1::Lease& lease);
  bool IsCurrent(const v1::Lease& lease, const std::shared_ptr<Outbox>& outbox) const;

  UnitRenderer* const renderer_;
  const std::shared_ptr<spdlog::logger> log_;
  std::vector<std::thread> threads_;

  mutable absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::shared_ptr<Outbox> outbox_ ABSL_GUARDED_BY(mutex_);
  std::deque<v1::Lease> waiting_ ABSL_GUARDED_BY(mutex_);
  std::vector<v1::Lease> held_ ABSL_GUARDED_BY(mutex_);
  int64_t newest_attempt_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<std::string, std::shared_ptr<const v1::JobSpec>> specs_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::worker
