#include "server/coordinator/plan_delivery.h"

#include <spdlog/logger.h>

#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/plan_text.h"
#include "server/job/plan.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

absl::Status PlanDelivery::Deliver(WorkerId worker, const UnitRef& unit, Attempt attempt,
                                   const v1::Plan& plan) const {
  FarmState::Change farm(state_);
  const ActiveJob* const active = farm->jobs.FindActive(unit.job);
  if (active == nullptr || !farm->scheduler.units().HoldsLease(worker, unit, attempt)) {
    farm->workers.Acknowledge(worker, unit, attempt);
    return absl::OkStatus();
  }
  absl::StatusOr<v1::JobSpec> planned = job::PlannedSpec(active->record.spec, plan);
  if (!planned.ok()) return planned.status();
  farm->scheduler.units().Complete(worker, unit, attempt, resources_->options.now());
  planned->mutable_plan()->set_numeric_class(farm->scheduler.jobs().NumericClassOf(unit.job));
  const auto shared = std::make_shared<const v1::JobSpec>(*std::move(planned));
  committer_->Write([this, job = unit.job, shared] { return Record(job, *shared); },
                    [this, worker, unit, attempt, shared](const absl::Status& status) {
                      OnRecorded(worker, unit, attempt, *shared, status);
                    });
  return absl::OkStatus();
}

absl::Status PlanDelivery::Record(const JobId& job, const v1::JobSpec& planned) const {
  if (FarmState::View(state_)->jobs.FindActive(job) == nullptr)
    return absl::CancelledError("the job has ended");
  // First the manifest: units are read back by the plan, and without the ledger it is the only one.
  const absl::Status written = RewriteManifest(resources_->folder, job, planned);
  if (IsStorageError(written)) return written;
  if (!written.ok()) {  // it is damaged: what it is for is lost already
    resources_->log().warn("event=manifest_not_written job={} error={}", job.value(),
                           logging::Quoted(written.message()));
  }
  return resources_->store->SetPlan(resources_->Owned(job), planned);
}

void PlanDelivery::OnRecorded(WorkerId worker, const UnitRef& unit, Attempt attempt,
                              const v1::JobSpec& planned, const absl::Status& status) const {
  FarmState::Change farm(state_);
  if (farm->jobs.FindActive(unit.job) == nullptr) return;  // it ended, or is being changed
  if (!status.ok()) {
    return farm->FailJob(unit.job,
                         absl::StrCat("the plan cannot be recorded: ", std::string(status.message())));
  }
  farm->SetPlan(unit, planned);
  resources_->log().info("event=job_planned job={} worker={} rays={} plan={}", unit.job.value(),
                         farm->workers.NameOf(worker), planned.plan().probe_rays(),
                         logging::Quoted(rpc::PlanLine(planned.plan())));
  farm->workers.Acknowledge(worker, unit, attempt);
  farm->watchers.MarkChanged(unit.job);
}

}  // namespace lumifold::server
