#include "proto/logging/job_labels.h"

#include "proto/logging/fields.h"

namespace lumifold::logging {

void JobLabels::Set(const std::string& job, JobLabel label) {
  absl::MutexLock lock(&mutex_);
  const auto [entry, is_new] = labels_.try_emplace(job);
  entry->second.label = std::move(label);
  if (is_new) {
    entry->second.use = uses_.insert(uses_.end(), job);
  } else {
    uses_.splice(uses_.end(), uses_, entry->second.use);
  }
  if (labels_.size() <= max_jobs_) return;
  labels_.erase(uses_.front());
  uses_.pop_front();
}

JobLabel JobLabels::Of(const std::string& job) {
  absl::MutexLock lock(&mutex_);
  const auto found = labels_.find(job);
  if (found == labels_.end()) return {};
  uses_.splice(uses_.end(), uses_, found->second.use);
  return found->second.label;
}

void JobLabels::SetWorker(std::string worker) {
  absl::MutexLock lock(&mutex_);
  worker_ = std::move(worker);
}

std::string JobLabels::worker() {
  absl::MutexLock lock(&mutex_);
  return worker_;
}

std::string JobOf(const Line& line) {
  if (const std::string_view job = line.Get("job"); !job.empty()) return std::string(job);
  const std::string_view unit = line.Get("unit");
  return std::string(unit.substr(0, unit.find(' ')));
}

}  // namespace lumifold::logging
