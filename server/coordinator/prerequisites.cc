#include "server/coordinator/prerequisites.h"

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/job/job_state.h"
#include "server/job/limits.h"

namespace lumifold::server {

using job::JobId;
using job::Prerequisite;

absl::StatusOr<std::vector<Prerequisite>> Prerequisites::Check(const v1::Scheduling& scheduling) const {
  if (scheduling.after_size() > job::kMaxPrerequisites) {
    return absl::InvalidArgumentError(absl::StrCat("scheduling.after names ", scheduling.after_size(),
                                                   " jobs, more than ", job::kMaxPrerequisites));
  }
  absl::StatusOr<std::vector<Prerequisite>> after = Read(scheduling);
  if (!after.ok()) return after;
  for (const Prerequisite& prerequisite : *after) {
    if (prerequisite.state == v1::JOB_STATE_UNSPECIFIED) {
      return absl::InvalidArgumentError(
          absl::StrCat("scheduling.after: there is no job ", logging::Quoted(prerequisite.job.value())));
    }
  }
  return after;
}

absl::StatusOr<std::vector<Prerequisite>> Prerequisites::Read(const v1::Scheduling& scheduling) const {
  std::vector<Prerequisite> after;
  for (const std::string& id : scheduling.after()) {
    const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(JobId(id));
    if (!record.ok() && !absl::IsNotFound(record.status())) return record.status();
    after.push_back({JobId(id), record.ok() ? record->state : v1::JOB_STATE_UNSPECIFIED});
  }
  return after;
}

void Prerequisites::LookAgain(const std::vector<Prerequisite>& after) const {
  for (const Prerequisite& prerequisite : after) {
    if (job::HasEnded(prerequisite.state)) continue;
    if (FarmState::View(state_)->jobs.IsInMemory(prerequisite.job)) continue;  // its end will be told
    const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(prerequisite.job);
    const bool is_gone = absl::IsNotFound(record.status());
    if (!is_gone && (!record.ok() || !job::HasEnded(record->state))) continue;
    FarmState::Change farm(state_);
    farm->Settle(is_gone ? farm->dependencies.Deleted(prerequisite.job)
                         : farm->dependencies.Ended(prerequisite.job, record->state));
  }
}

void Prerequisites::LookAtAll() const {
  std::vector<Prerequisite> after;
  {
    FarmState::View farm(state_);
    for (const JobId& job : farm->dependencies.Named()) {
      if (!farm->jobs.IsInMemory(job)) after.push_back({job, v1::JOB_STATE_RUNNING});
    }
  }
  LookAgain(after);
}

}  // namespace lumifold::server
