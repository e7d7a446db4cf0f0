#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/worker.pb.h"
#include "server/commit/unit_sender.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/frame_finishing.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"

namespace lumifold::server {

/// Frames that workers finish: what they fetch for it, and their results.
/// Threads: safe.
class FinishDelivery {
 public:
  /// All must outlive it.
  FinishDelivery(Resources* resources, FarmState* state, FrameFinishing* finishing)
      : resources_(resources), state_(state), finishing_(finishing) {}

  /// See WorkerApi.
  absl::StatusOr<UnitSender> OpenUnits(const v1::FetchUnitsRequest& request, const std::string& caller) const;
  absl::StatusOr<std::unique_ptr<ResultUpload>> Receive(const v1::ResultAnnouncement& announcement,
                                                        const std::string& caller) const;
  /// The worker will not deliver the result of a lease.
  void TakeBack(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                const std::string& reason, Farm::Return how) const;

 private:
  /// The levels of light of a frame, once the headers of its units are read: others who want them wait.
  struct FrameLevels {
    absl::Mutex mutex;
    std::optional<uint64_t> levels ABSL_GUARDED_BY(mutex);
    size_t units ABSL_GUARDED_BY(mutex) = 0;  // CommittedUnits::Fingerprint of what was read
  };

  /// The levels of light that the frame has, as v1::ByteChunk has them.
  absl::StatusOr<uint64_t> LevelsOf(const FrameKey& frame, const v1::JobSpec& spec,
                                    const CommittedUnits& units) const;

  Resources* const resources_;
  FarmState* const state_;
  FrameFinishing* const finishing_;
  mutable absl::Mutex mutex_;
  mutable std::map<FrameKey, std::shared_ptr<FrameLevels>> levels_ ABSL_GUARDED_BY(mutex_);  // of some frames
};

}  // namespace lumifold::server
