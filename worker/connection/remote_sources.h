#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "proto/logging/job_labels.h"
#include "worker/cache/asset_source.h"
#include "worker/cache/spec_cache.h"
#include "worker/finish/frame_link.h"

namespace grpc {
class Channel;
}

namespace lumifold::worker {

/// The coordinator that the worker is connected to, and as whom: it serves specs and assets to connected
/// workers only.
/// Threads: safe.
class CurrentCoordinator {
 public:
  struct Link {
    std::shared_ptr<grpc::Channel> channel;  // null: not connected
    std::string worker_id;
    int64_t number = 0;  // of the connection; two coordinators may give the same id
  };

  void Set(std::shared_ptr<grpc::Channel> channel, std::string worker_id) {
    absl::MutexLock lock(&mutex_);
    if (channel != nullptr) ++connections_;
    link_ = {std::move(channel), std::move(worker_id), link_.number + 1};
  }
  void Clear() { Set(nullptr, ""); }
  Link Get() const {
    absl::MutexLock lock(&mutex_);
    return link_;
  }
  /// How often it was set.
  int64_t connections() const {
    absl::MutexLock lock(&mutex_);
    return connections_;
  }

 private:
  mutable absl::Mutex mutex_;
  Link link_ ABSL_GUARDED_BY(mutex_);
  int64_t connections_ ABSL_GUARDED_BY(mutex_) = 0;
};

/// Fetches assets from the current coordinator and resumes broken transfers, also from another one: the
/// content is known by its SHA-256. Its calls are of the job's trace, where `labels` has it. `coordinator`
/// must outlive it.
std::unique_ptr<AssetSource> MakeRemoteAssetSource(const CurrentCoordinator* coordinator,
                                                   std::shared_ptr<logging::JobLabels> labels);

/// The same for specs.
std::unique_ptr<SpecSource> MakeRemoteSpecSource(const CurrentCoordinator* coordinator,
                                                 std::shared_ptr<logging::JobLabels> labels);

/// Its link for frames that it finishes. A broken transfer is not tried again: the lease ends with it.
std::unique_ptr<FrameLink> MakeRemoteFrameLink(const CurrentCoordinator* coordinator,
                                               std::shared_ptr<logging::JobLabels> labels);

}  // namespace lumifold::worker
