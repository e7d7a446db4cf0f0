// Plan units: how a job gets its plan.
//
// A plan unit is leased, accepted, lost and failed like any other. What it delivers is committed with the job's spec in
// one transaction of the ledger: a crash before leaves a job whose plan unit is leased again, a crash after it a job with
// this plan.
#include <spdlog/logger.h>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/plan_text.h"
#include "server/coordinator/coordinator.h"
#include "server/job/plan.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

absl::Status Coordinator::DeliverPlan(WorkerId worker, const UnitRef& unit, Attempt attempt,
                                      const v1::Plan& plan) {
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(unit.job);
  if (active == active_jobs_.end() || !scheduler_.HoldsLease(worker, unit, attempt)) {
    Acknowledge(worker, unit, attempt);
    return absl::OkStatus();
  }
  absl::StatusOr<v1::JobSpec> planned = job::PlannedSpec(active->second.spec, plan);
  if (!planned.ok()) return planned.status();
  scheduler_.CompleteUnit(worker, unit, attempt, options_.now());
  planned->mutable_plan()->set_numeric_class(scheduler_.NumericClassOf(unit.job));
  const auto shared = std::make_shared<const v1::JobSpec>(*std::move(planned));
  committer_->Write([this, job = unit.job, shared] { return RecordPlan(job, *shared); },
                    [this, worker, unit, attempt, shared](const absl::Status& status) {
                      OnPlanRecorded(worker, unit, attempt, *shared, status);
                    });
  return absl::OkStatus();
}

absl::Status Coordinator::RecordPlan(const JobId& job, const v1::JobSpec& planned) {
  if (!IsWanted(job)) return absl::CancelledError("the job has ended");
  // First the manifest: units are read back by the plan, and without the ledger it is the only one.
  const absl::Status written = RewriteManifest(folder_, job, planned);
  if (IsStorageError(written)) return written;
  if (!written.ok()) {  // it is damaged: what it is for is lost already
    options_.log->warn("event=manifest_not_written job={} error={}", job.value(),
                       logging::Quoted(std::string(written.message())));
  }
  return store_->SetPlan(Owned(job), planned);
}

void Coordinator::OnPlanRecorded(WorkerId worker, const UnitRef& unit, Attempt attempt,
                                 const v1::JobSpec& planned, const absl::Status& status) {
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(unit.job);
  if (active == active_jobs_.end()) return;  // it ended, or is being changed
  if (!status.ok()) {
    return EndJob(unit.job, v1::JOB_STATE_FAILED,
                  absl::StrCat("the plan cannot be recorded: ", std::string(status.message())));
  }
  active->second.spec = planned;
  scheduler_.SetPlan(unit, planned);
  LimitFramesFor(unit.job);
  options_.log->info("event=job_planned job={} worker={} rays={} plan={}", unit.job.value(), NameOf(worker),
                     planned.plan().probe_rays(), logging::Quoted(rpc::PlanLine(planned.plan())));
  Acknowledge(worker, unit, attempt);
  changed_jobs_.insert(unit.job);
  housekeeping_.Notify();
  GrantLeases();
}

absl::StatusOr<v1::Plan> Coordinator::PlanOf(const JobId& job) {
  {
    absl::MutexLock lock(&mutex_);
    const auto active = active_jobs_.find(job);
    if (active != active_jobs_.end()) return active->second.spec.plan();
  }
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  return record->spec.plan();
}

}  // namespace lumifold::server
