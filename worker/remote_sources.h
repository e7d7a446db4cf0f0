#pragma once

#include <memory>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "worker/asset_source.h"
#include "worker/spec_cache.h"

namespace grpc {
class Channel;
}

namespace lumifold::worker {

/// The id that the coordinator has given this worker: it serves specs and assets to connected workers only.
/// Threads: safe.
class AssignedId {
 public:
  /// Empty: not connected.
  void Set(std::string worker_id) {
    absl::MutexLock lock(&mutex_);
    worker_id_ = std::move(worker_id);
  }
  std::string Get() const {
    absl::MutexLock lock(&mutex_);
    return worker_id_;
  }

 private:
  mutable absl::Mutex mutex_;
  std::string worker_id_ ABSL_GUARDED_BY(mutex_);
};

/// Fetches assets from the coordinator and resumes broken transfers, also after a reconnection. `id` must outlive it.
std::unique_ptr<AssetSource> MakeRemoteAssetSource(std::shared_ptr<grpc::Channel> channel,
                                                   const AssignedId* id);

/// Fetches specs from the coordinator. `id` must outlive it.
std::unique_ptr<SpecSource> MakeRemoteSpecSource(std::shared_ptr<grpc::Channel> channel,
                                                 const AssignedId* id);

}  // namespace lumifold::worker
