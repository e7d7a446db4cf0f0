#include "worker/cache/spec_cache.h"

#include <utility>

namespace lumifold::worker {
namespace {

/// Whether the spec is of the time of the unit: before or after the job was planned.
bool Fits(const v1::JobSpec& spec, v1::UnitKind kind) {
  return kind == v1::UNIT_KIND_PLAN || spec.planning().mode() == v1::PLAN_MODE_FULL || spec.has_plan();
}

}  // namespace

absl::StatusOr<std::shared_ptr<const v1::JobSpec>> SpecCache::Get(const std::string& job_id,
                                                                  v1::UnitKind kind) {
  int64_t clears = 0;
  {
    absl::MutexLock lock(&mutex_);
    const auto is_settled = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return !fetching_.contains(job_id); };
    mutex_.Await(absl::Condition(&is_settled));
    const auto found = specs_.find(job_id);
    if (found != specs_.end() && Fits(*found->second, kind)) return found->second;
    fetching_.insert(job_id);
    clears = clears_;
  }
  absl::StatusOr<v1::JobSpec> fetched = source_->Fetch(job_id);
  absl::MutexLock lock(&mutex_);
  // After Clear() another thread may be fetching it from another coordinator.
  const bool is_wanted = clears == clears_ && fetching_.erase(job_id) > 0;
  if (!fetched.ok()) return fetched.status();
  auto spec = std::make_shared<const v1::JobSpec>(*std::move(fetched));
  if (is_wanted) specs_[job_id] = spec;
  return spec;
}

void SpecCache::Forget(const std::string& job_id) {
  absl::MutexLock lock(&mutex_);
  specs_.erase(job_id);
  fetching_.erase(job_id);
}

void SpecCache::Clear() {
  absl::MutexLock lock(&mutex_);
  specs_.clear();
  fetching_.clear();
  ++clears_;
}

}  // namespace lumifold::worker
