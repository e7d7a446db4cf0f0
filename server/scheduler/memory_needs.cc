#include "server/scheduler/memory_needs.h"

#include <algorithm>

namespace lumifold::scheduler {

uint64_t MemoryNeeds::Need::bytes() const {
  return worker.empty() ? planned : std::max(planned, too_little + 1);
}

void MemoryNeeds::RanOut(int64_t job, const std::string& worker, uint64_t bytes, absl::Time until) {
  Need& need = needs_.at(job);
  const uint64_t most = std::max(bytes, need.too_little);
  const std::string whose = bytes >= need.too_little ? worker : need.worker;
  Forget(job, &need);
  need.too_little = most;
  need.worker = whose;
  need.until = until;
  ends_.emplace(until, job);
}

void MemoryNeeds::Forget(int64_t job, Need* need) {
  ends_.erase({need->until, job});
  *need = {.planned = need->planned, .too_little = 0, .worker = {}};
}

std::vector<int64_t> MemoryNeeds::TakeEnded(absl::Time now) {
  std::vector<int64_t> jobs;
  while (NextEnd() <= now) {
    const int64_t job = ends_.begin()->second;
    Forget(job, &needs_.at(job));
    jobs.push_back(job);
  }
  return jobs;
}

void MemoryNeeds::EndJob(int64_t job) {
  const auto need = needs_.find(job);
  if (need == needs_.end()) return;
  Forget(job, &need->second);
  needs_.erase(need);
}

}  // namespace lumifold::scheduler
