#include "server/services/job_access.h"

#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/access/authorisation.h"
#include "server/coordinator/roles.h"

namespace lumifold::server {
namespace {

template <typename Request>
std::optional<Request> OfCaller(const access::Identity& caller, Request request) {
  if (access::ReachesAllJobs(caller)) return request;
  if (!request.user().empty() && request.user() != caller.name) return std::nullopt;
  request.set_user(caller.name);
  return request;
}

}  // namespace

absl::Status JobAccess::Check(const access::Identity& caller, const std::string& job_id) const {
  if (access::ReachesAllJobs(caller)) return absl::OkStatus();
  const absl::StatusOr<std::string> user = jobs_->UserOf(job_id);
  if (!user.ok()) return user.status();
  if (*user == caller.name) return absl::OkStatus();
  return absl::NotFoundError(
      absl::StrCat("no job ", absl::Utf8SafeCEscape(job_id)));  // as the ledger says it
}

absl::StatusOr<v1::SubmitJobRequest> JobAccess::Claim(const access::Identity& caller,
                                                      const v1::SubmitJobRequest& request) const {
  v1::SubmitJobRequest claimed = request;
  if (caller.kind == access::IdentityKind::kLocal) return claimed;
  std::string* user = claimed.mutable_scheduling()->mutable_user();
  if (user->empty()) *user = caller.name;
  if (access::ReachesAllJobs(caller)) return claimed;
  if (*user != caller.name) {
    return absl::PermissionDeniedError(absl::StrCat("scheduling.user is ", logging::Quoted(*user),
                                                    ": jobs of others need the scope admin, you are ",
                                                    logging::Quoted(caller.name)));
  }
  for (const std::string& job : claimed.scheduling().after()) {
    const absl::Status own = Check(caller, job);
    if (absl::IsNotFound(own))
      return absl::InvalidArgumentError(
          absl::StrCat("scheduling.after: there is no job ", logging::Quoted(job)));
    if (!own.ok()) return own;
  }
  return claimed;
}

std::optional<v1::ListJobsRequest> JobAccess::Restrict(const access::Identity& caller,
                                                       const v1::ListJobsRequest& request) const {
  return OfCaller(caller, request);
}

std::optional<v1::GetUsageRequest> JobAccess::Restrict(const access::Identity& caller,
                                                       const v1::GetUsageRequest& request) const {
  return OfCaller(caller, request);
}

absl::Status JobAccess::CheckLog(const access::Identity& caller, const v1::GetLogRequest& request) const {
  if (access::ReachesAllJobs(caller)) return absl::OkStatus();
  if (!request.worker().empty())
    return absl::PermissionDeniedError(
        "the log of a worker names jobs of all users: it needs the scope admin");
  return Check(caller, request.job_id());
}

v1::ListWorkersResponse JobAccess::Shown(const access::Identity& caller,
                                         v1::ListWorkersResponse workers) const {
  if (access::ReachesAllJobs(caller)) return workers;
  for (v1::WorkerStatus& worker : *workers.mutable_workers()) {
    worker.clear_reason();
    v1::WorkerStatus own;
    for (const std::string& job : worker.job_ids()) {
      if (Check(caller, job).ok()) own.add_job_ids(job);
    }
    worker.mutable_job_ids()->Swap(own.mutable_job_ids());
    for (const v1::FrameOfWorker& frame : worker.history()) {
      if (Check(caller, frame.job_id()).ok()) *own.add_history() = frame;
    }
    worker.mutable_history()->Swap(own.mutable_history());
  }
  return workers;
}

}  // namespace lumifold::server
