// Jobs that wait for other jobs.
#include <spdlog/logger.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/coordinator/coordinator.h"
#include "server/job/job_state.h"
#include "server/job/limits.h"

namespace lumifold::server {

using job::JobId;
using job::Prerequisite;

absl::StatusOr<std::vector<Prerequisite>> Coordinator::CheckAfter(const v1::Scheduling& scheduling) {
  if (scheduling.after_size() > job::kMaxPrerequisites) {
    return absl::InvalidArgumentError(absl::StrCat("scheduling.after names ", scheduling.after_size(),
                                                   " jobs, more than ", job::kMaxPrerequisites));
  }
  absl::StatusOr<std::vector<Prerequisite>> after = ReadPrerequisites(scheduling);
  if (!after.ok()) return after;
  for (const Prerequisite& prerequisite : *after) {
    if (prerequisite.state == v1::JOB_STATE_UNSPECIFIED) {
      return absl::InvalidArgumentError(
          absl::StrCat("scheduling.after: there is no job ", logging::Quoted(prerequisite.job.value())));
    }
  }
  return after;
}

absl::StatusOr<std::vector<Prerequisite>> Coordinator::ReadPrerequisites(const v1::Scheduling& scheduling) {
  std::vector<Prerequisite> after;
  for (const std::string& id : scheduling.after()) {
    const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(JobId(id));
    if (!record.ok() && !absl::IsNotFound(record.status())) return record.status();
    after.push_back({JobId(id), record.ok() ? record->state : v1::JOB_STATE_UNSPECIFIED});
  }
  return after;
}

void Coordinator::AwaitPrerequisites(const JobId& job, std::vector<Prerequisite> after) {
  if (after.empty()) return;
  for (Prerequisite& prerequisite : after) {
    // What is in memory is newer than what was read.
    if (IsInMemory(prerequisite.job)) prerequisite.state = v1::JOB_STATE_RUNNING;
  }
  const job::Settled settled = dependencies_.Add(job, after);
  if (dependencies_.IsWaiting(job)) {
    scheduler_.PauseJob(job);
    janitor_.SetNeeded(dependencies_.Named());
    return;
  }
  for (const job::HopelessJob& hopeless : settled.hopeless)
    EndJob(hopeless.job, v1::JOB_STATE_FAILED, hopeless.reason);
}

void Coordinator::CheckPrerequisites(const std::vector<Prerequisite>& after) {
  for (const Prerequisite& prerequisite : after) {
    if (job::HasEnded(prerequisite.state)) continue;
    {
      absl::MutexLock lock(&mutex_);
      if (IsInMemory(prerequisite.job)) continue;  // its end will be told
    }
    const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(prerequisite.job);
    const bool is_gone = absl::IsNotFound(record.status());
    if (!is_gone && (!record.ok() || !job::HasEnded(record->state))) continue;
    absl::MutexLock lock(&mutex_);
    Settle(is_gone ? dependencies_.Deleted(prerequisite.job)
                   : dependencies_.Ended(prerequisite.job, record->state));
  }
}

void Coordinator::Settle(const job::Settled& settled) {
  for (const JobId& job : settled.released) {
    const auto active = active_jobs_.find(job);
    if (active == active_jobs_.end()) continue;
    if (!active->second.scheduling.paused()) scheduler_.ResumeJob(job);
    options_.log->info("event=job_released job={}", job.value());
    changed_jobs_.insert(job);
  }
  for (const job::HopelessJob& job : settled.hopeless) EndJob(job.job, v1::JOB_STATE_FAILED, job.reason);
  if (settled.released.empty() && settled.hopeless.empty()) return;
  janitor_.SetNeeded(dependencies_.Named());
  housekeeping_.Notify();
  GrantLeases();
}

}  // namespace lumifold::server
