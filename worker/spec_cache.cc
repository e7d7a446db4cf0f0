#include "worker/spec_cache.h"

#include <utility>

namespace lumifold::worker {

absl::StatusOr<std::shared_ptr<const v1::JobSpec>> SpecCache::Get(const std::string& job_id) {
  {
    absl::MutexLock lock(&mutex_);
    const auto is_settled = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return !fetching_.contains(job_id); };
    mutex_.Await(absl::Condition(&is_settled));
    const auto found = specs_.find(job_id);
    if (found != specs_.end()) return found->second;
    fetching_.insert(job_id);
  }
  absl::StatusOr<v1::JobSpec> fetched = source_->Fetch(job_id);
  absl::MutexLock lock(&mutex_);
  const bool is_wanted = fetching_.erase(job_id) > 0;
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
}

}  // namespace lumifold::worker
