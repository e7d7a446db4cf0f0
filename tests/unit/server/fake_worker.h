#pragma once

#include <grpcpp/grpcpp.h>

#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/version.h"

namespace lumifold::server {

struct FakeWorkerOptions {
  std::string numeric_class = "test";
  int slots = 3;
  int wire_version = rpc::kWireVersion;
  /// Breaks the connection within a unit, after this number of complete units.
  int vanish_after = 1'000'000'000;
  /// Says that it has received each grant. So that this arrives, vanish_after then ends the stream in order.
  bool answers_grants = false;
  /// Changes a message before it is sent.
  std::function<void(v1::WorkerMessage&)> spoil = [](v1::WorkerMessage&) {};
};

/// Implements the worker's side of the protocol over a real connection and delivers RandomUnit for every
/// lease.
class FakeWorker {
 public:
  FakeWorker(const std::shared_ptr<grpc::Channel>& channel, FakeWorkerOptions options);
  ~FakeWorker();

  /// Waits until the coordinator, or vanish_after, has ended the stream; returns its status.
  grpc::Status Wait();
  /// Breaks the connection.
  void Vanish() { context_.TryCancel(); }

  int delivered() const;
  /// Units that the coordinator has acknowledged, refused or not.
  int acknowledged() const;
  std::vector<std::string> ended_jobs() const;
  /// Reasons of the units that the coordinator refused, in order.
  std::vector<std::string> refusals() const;
  bool WaitForDrain() const;
  bool WaitForEndOf(const std::string& job_id) const;

 private:
  using Stream = grpc::ClientReaderWriter<v1::WorkerMessage, v1::CoordinatorMessage>;
  void Run();
  bool OnMessage(const v1::CoordinatorMessage& message, Stream* stream);
  bool Deliver(const v1::Lease& lease, Stream* stream);
  bool Send(v1::WorkerMessage message, Stream* stream);

  const FakeWorkerOptions options_;
  const std::unique_ptr<v1::WorkerService::Stub> stub_;
  grpc::ClientContext context_;
  mutable absl::Mutex mutex_;
  bool is_drained_ ABSL_GUARDED_BY(mutex_) = false;
  int delivered_ ABSL_GUARDED_BY(mutex_) = 0;
  int acknowledged_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<std::string> refusals_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::string> ended_jobs_ ABSL_GUARDED_BY(mutex_);
  grpc::Status result_;
  std::thread thread_;
};

}  // namespace lumifold::server
