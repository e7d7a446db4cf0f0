#include "client/farm/find_job.h"

#include <algorithm>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace lumifold::client {
namespace {

constexpr int kPageJobs = 1000;  // the coordinator's limit
constexpr size_t kMaxNamed = 5;  // jobs that an error names
constexpr char kIdPrefix[] = "j-";
constexpr size_t kIdLength = 18;

bool IsWholeId(const std::string& name) {
  return name.size() == kIdLength && name.starts_with(kIdPrefix) &&
         std::all_of(name.begin() + 2, name.end(), absl::ascii_isalnum);
}

absl::Status NoJob(const std::string& name) {
  return absl::NotFoundError(absl::StrCat("no job '", name, "'"));
}

absl::StatusOr<std::string> LastJob(FarmClient& farm, absl::FunctionRef<absl::StatusOr<std::string>()> user) {
  const absl::StatusOr<std::string> owner = user();
  if (!owner.ok()) return owner.status();
  v1::ListJobsRequest request;
  request.set_limit(1);
  request.set_user(*owner);
  const absl::StatusOr<v1::ListJobsResponse> newest = farm.ListJobs(request);
  if (!newest.ok()) return newest.status();
  if (newest->jobs().empty())
    return absl::NotFoundError(absl::StrCat("there is no job of user '", *owner, "'"));
  return newest->jobs(0).job_id();
}

absl::StatusOr<std::string> TheOne(const std::string& name, const std::vector<std::string>& jobs) {
  if (jobs.empty()) return NoJob(name);
  if (jobs.size() == 1) return jobs.front();
  const size_t named = std::min(jobs.size(), kMaxNamed);
  return absl::InvalidArgumentError(absl::StrCat(
      "'", name, "' means ", jobs.size(),
      " jobs: ", absl::StrJoin(jobs.begin(), jobs.begin() + static_cast<std::ptrdiff_t>(named), ", "),
      named < jobs.size() ? ", ..." : ""));
}

}  // namespace

absl::StatusOr<std::string> FindJob(FarmClient& farm, const std::string& name,
                                    absl::FunctionRef<absl::StatusOr<std::string>()> user) {
  if (IsWholeId(name)) return name;
  if (name.empty()) return NoJob(name);
  if (name == kLastJob) return LastJob(farm, user);
  const absl::StatusOr<v1::JobStatus> exact = farm.GetJob(name);
  if (exact.ok()) return name;
  if (!absl::IsNotFound(exact.status())) return exact.status();
  std::vector<std::string> called;
  std::vector<std::string> abbreviated;
  v1::ListJobsRequest request;
  request.set_limit(kPageJobs);
  do {
    const absl::StatusOr<v1::ListJobsResponse> page = farm.ListJobs(request);
    if (!page.ok()) return page.status();
    for (const v1::JobStatus& job : page->jobs()) {
      if (job.display_name() == name) called.push_back(job.job_id());
      if (absl::StartsWith(job.job_id(), name) || absl::EndsWith(job.job_id(), name))
        abbreviated.push_back(job.job_id());
    }
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return TheOne(name, called.empty() ? abbreviated : called);
}

}  // namespace lumifold::client
