#pragma once

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <atomic>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/credentials.h"
#include "proto/threads/task_thread.h"
#include "tests/bench/farm_load_results.h"
#include "tests/bench/farm_load_units.h"

namespace lumifold::bench {

/// What all workers of a load have seen.
/// Threads: safe.
class LoadCounters {
 public:
  std::atomic<int> welcomed = 0;
  std::atomic<int> ended = 0;
  std::atomic<int64_t> committed = 0;
  std::atomic<int64_t> refused = 0;
  std::atomic<int64_t> committed_bytes = 0;
  std::atomic<int64_t> finished = 0;  // frames
  std::atomic<int64_t> kept = 0;      // of these

  /// Times are kept between Start and Stop only.
  void StartTiming();
  void StopTiming();
  void AddLease(absl::Duration free_to_lease);
  void AddCommit(absl::Duration delivered_to_acknowledged);
  /// Sorted, in milliseconds.
  std::vector<double> lease_ms() const;
  std::vector<double> commit_ms() const;
  /// Reasons for which units were refused and streams ended, at most ten.
  void AddError(const std::string& error);
  std::vector<std::string> errors() const;

 private:
  mutable absl::Mutex mutex_;
  bool timing_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<double> lease_ms_ ABSL_GUARDED_BY(mutex_);
  std::vector<double> commit_ms_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::string> errors_ ABSL_GUARDED_BY(mutex_);
};

/// A worker that answers each lease with a unit that is ready, on a connection of its own. Sends raw bytes,
/// so that N workers cost little more than the system's sockets. With results it finishes frames too, one at
/// a time, and keeps them if it is asked to.
/// Threads: safe.
class LoadWorker final : private grpc::ClientBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  /// `units`, `results`, which may be null, and `counters` must outlive it.
  LoadWorker(const std::string& address, const rpc::Security& security, const std::string& name, int slots,
             ReadyUnits* units, const ReadyResults* results, LoadCounters* counters);
  ~LoadWorker() override;

  void SendHeartbeat();
  void Cancel() { context_.TryCancel(); }

 private:
  /// A delivered unit that is not acknowledged.
  struct Delivered {
    v1::Lease lease;
    absl::Time at;
    int64_t bytes = 0;
  };

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone(const grpc::Status& status) override;
  void OnGrant(const v1::Grant& grant);
  void Answer(const v1::Lease& lease, absl::Time now);
  void Finish(const v1::Lease& lease);
  void OnAck(const v1::UnitAck& ack);
  void Send(grpc::ByteBuffer message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  ReadyUnits* const units_;
  const ReadyResults* const results_;
  LoadCounters* const counters_;
  const std::shared_ptr<grpc::Channel> channel_;
  grpc::GenericStub stub_;
  v1::WorkerService::Stub calls_;
  grpc::ClientContext context_;
  grpc::ByteBuffer incoming_;
  absl::Notification done_;

  absl::Mutex mutex_;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<grpc::ByteBuffer> outgoing_ ABSL_GUARDED_BY(mutex_);   // the front is being written
  std::map<int64_t, Delivered> delivered_ ABSL_GUARDED_BY(mutex_);  // by attempt
  std::deque<absl::Time> free_since_ ABSL_GUARDED_BY(mutex_);       // slots without a lease
  int64_t newest_attempt_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t progress_ ABSL_GUARDED_BY(mutex_) = 0;
  std::string id_ ABSL_GUARDED_BY(mutex_);
  threads::TaskThread finisher_{threads::TaskThread::Priority::kNormal};
};

}  // namespace lumifold::bench
