#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/worker.pb.h"

namespace lumifold::worker {

/// Source of the specs of jobs.
/// Threads: implementations are safe concurrently.
class SpecSource {
 public:
  virtual ~SpecSource() = default;

  /// The spec of an active job.
  /// Errors: kNotFound for a job that has ended; kPermissionDenied when this worker has no lease of the job
  /// any more; kUnavailable and others when the coordinator cannot be reached.
  virtual absl::StatusOr<v1::JobSpec> Fetch(const std::string& job_id) = 0;
};

/// Fetches the spec of each job once, and again when it is planned. Threads that want a spec that is being
/// fetched wait for it.
/// Threads: safe concurrently.
class SpecCache {
 public:
  /// `source` must outlive it.
  explicit SpecCache(SpecSource* source) : source_(source) {}

  /// The spec for a unit of this kind: all kinds but plan units are of jobs that are planned.
  /// Errors: those of the source; they are not kept.
  absl::StatusOr<std::shared_ptr<const v1::JobSpec>> Get(const std::string& job_id, v1::UnitKind kind);
  /// The job has ended. A spec that is being fetched is not kept.
  void Forget(const std::string& job_id);
  /// The same for all jobs.
  void Clear();

 private:
  SpecSource* const source_;
  absl::Mutex mutex_;
  std::map<std::string, std::shared_ptr<const v1::JobSpec>> specs_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> fetching_ ABSL_GUARDED_BY(mutex_);
  int64_t clears_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace lumifold::worker
