#pragma once

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace grpc {
class HealthCheckServiceInterface;
}

namespace lumifold::server {

/// What gRPC's health service says of all our services: they serve while the storage can be written and the
/// server does not stop.
/// Threads: safe.
class ServiceHealth {
 public:
  /// `service` must outlive all further calls, or be followed by none that changes anything.
  void Begin(grpc::HealthCheckServiceInterface* service);
  void SetStorage(bool is_writable);
  void Stop();

 private:
  void Show() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Mutex mutex_;
  grpc::HealthCheckServiceInterface* service_ ABSL_GUARDED_BY(mutex_) = nullptr;
  bool has_storage_ ABSL_GUARDED_BY(mutex_) = true;
  bool stops_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace lumifold::server
