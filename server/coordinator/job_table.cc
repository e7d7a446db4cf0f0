#include "server/coordinator/job_table.h"

#include <utility>

namespace lumifold::server {
namespace {

using job::JobId;

template <typename Map>
auto* Find(Map& map, const JobId& job) {
  const auto found = map.find(job);
  return found == map.end() ? nullptr : &found->second;
}

}  // namespace

ActiveJob* JobTable::FindActive(const JobId& job) { return Find(active_, job); }
const ActiveJob* JobTable::FindActive(const JobId& job) const { return Find(active_, job); }
EndingJob* JobTable::FindEnding(const JobId& job) { return Find(ending_, job); }
const EndingJob* JobTable::FindEnding(const JobId& job) const { return Find(ending_, job); }
SuspendedJob* JobTable::FindSuspended(const JobId& job) { return Find(suspended_, job); }
const SuspendedJob* JobTable::FindSuspended(const JobId& job) const { return Find(suspended_, job); }

ActiveJob* JobTable::Activate(ledger::JobRecord record) {
  const JobId job = record.id;
  ActiveJob* const active = &active_[job];
  active->record = std::move(record);
  return active;
}

std::optional<ActiveJob> JobTable::TakeActive(const JobId& job) {
  auto taken = active_.extract(job);
  if (taken.empty()) return std::nullopt;
  return std::move(taken.mapped());
}

std::vector<JobId> JobTable::Ending() const {
  std::vector<JobId> jobs;
  for (const auto& [job, entry] : ending_) jobs.push_back(job);
  return jobs;
}

EndingJob JobTable::TakeEnding(const JobId& job) { return std::move(ending_.extract(job).mapped()); }

std::set<std::string> JobTable::WantedAssets() const {
  std::set<std::string> wanted;
  for (const auto& [id, job] : active_) {
    if (job.wanted_asset.has_value()) wanted.insert(job.wanted_asset->sha256());
  }
  return wanted;
}

std::vector<JobId> JobTable::WaitingForAsset(const std::string& sha256) const {
  std::vector<JobId> jobs;
  for (const auto& [id, job] : active_) {
    if (job.wanted_asset.has_value() && job.wanted_asset->sha256() == sha256) jobs.push_back(id);
  }
  return jobs;
}

int64_t JobTable::CountOf(const std::string& user) const {
  int64_t jobs = 0;
  for (const auto& [id, job] : active_) jobs += job.record.scheduling.user() == user ? 1 : 0;
  for (const auto& [id, job] : suspended_) jobs += job.shown.scheduling().user() == user ? 1 : 0;
  return jobs;
}

bool SubmissionTable::Begin(const std::string& user, int64_t jobs, int limit) {
  const auto running = running_.find(user);
  const int submissions = running == running_.end() ? 0 : running->second;
  if (jobs + submissions >= limit) return false;
  running_[user] = submissions + 1;
  return true;
}

void SubmissionTable::End(const std::string& user) {
  const auto running = running_.find(user);
  if (--running->second == 0) running_.erase(running);
}

}  // namespace lumifold::server
