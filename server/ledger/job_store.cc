#include "server/ledger/job_store.h"

#include "absl/strings/str_cat.h"

namespace lumifold::ledger {

absl::Status OtherOwner(const job::JobId& job, Epoch owner, Epoch caller) {
  return absl::AbortedError(absl::StrCat("job ", job.value(), " belongs to the coordinator of epoch ",
                                         owner.value(), ", not to that of epoch ", caller.value()));
}

absl::Status CheckOwner(JobStore& store, const OwnedJob& job) {
  const absl::StatusOr<JobRecord> record = store.GetJob(job.job);
  if (!record.ok()) return record.status();
  return record->owner.epoch == job.epoch ? absl::OkStatus()
                                          : OtherOwner(job.job, record->owner.epoch, job.epoch);
}

}  // namespace lumifold::ledger
