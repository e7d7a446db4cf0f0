#include "server/page/farm_view.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "proto/rpc/message_json.h"
#include "server/page/farm_calls.h"

namespace lumifold::page {
namespace {

/// Jobs and workers on the page, at most.
constexpr int kMostJobs = 500;
constexpr int kMostWorkers = 500;
/// What nobody has asked for in this time is forgotten.
constexpr absl::Duration kMemory = absl::Seconds(30);

std::string EventOf(const char* name, const std::string& json) {
  return absl::StrCat("event: ", name, "\ndata: ", json, "\n\n");
}

void Renew(FarmLook::Part* part, std::string json, uint64_t number) {
  if (part->json == json) return;
  *part = {std::move(json), number};
}

/// Job ids need no escapes.
std::string IdsJson(const std::vector<std::string>& ids, bool more) {
  const std::string list = ids.empty() ? "" : absl::StrCat("\"", absl::StrJoin(ids, "\",\""), "\"");
  return absl::StrCat("{\"ids\":[", list, "],\"more\":", more ? "true" : "false", "}");
}

void TakeJobs(const std::vector<v1::JobStatus>& jobs, bool more, FarmLook* look) {
  std::map<std::string, FarmLook::Part> before = std::exchange(look->jobs, {});
  look->order.clear();
  for (const v1::JobStatus& job : jobs) {
    FarmLook::Part part = std::move(before[job.job_id()]);
    Renew(&part, rpc::JsonOf(job), look->number);
    look->jobs.emplace(job.job_id(), std::move(part));
    look->order.push_back(job.job_id());
  }
  Renew(&look->ids, IdsJson(look->order, more), look->number);
}

absl::Status LookAtJobs(const FarmCalls& calls, const v1::PageSession& session, FarmLook* look) {
  std::vector<v1::JobStatus> jobs;
  if (!session.job_id().empty()) {
    v1::GetJobRequest request;
    request.set_job_id(session.job_id());
    if (absl::Status status = calls.Call(session, "GetJob", request, &jobs.emplace_back()); !status.ok())
      return status;
    TakeJobs(jobs, /*more=*/false, look);
    return absl::OkStatus();
  }
  v1::ListJobsRequest request;
  request.set_limit(kMostJobs);
  v1::ListJobsResponse response;
  if (absl::Status status = calls.Call(session, "ListJobs", request, &response); !status.ok()) return status;
  jobs.assign(response.jobs().begin(), response.jobs().end());
  TakeJobs(jobs, !response.next_page_token().empty(), look);
  return absl::OkStatus();
}

absl::Status LookAtWorkers(const FarmCalls& calls, const v1::PageSession& session, FarmLook* look) {
  v1::ListWorkersRequest request;
  v1::ListWorkersResponse all;
  do {
    v1::ListWorkersResponse page;
    if (absl::Status status = calls.Call(session, "ListWorkers", request, &page); !status.ok()) return status;
    all.mutable_workers()->MergeFrom(page.workers());
    request.set_page_token(page.next_page_token());
  } while (!request.page_token().empty() && all.workers_size() < kMostWorkers);
  std::vector<std::string> workers;
  workers.reserve(static_cast<size_t>(all.workers_size()));
  for (const v1::WorkerStatus& worker : all.workers()) workers.push_back(rpc::JsonOf(worker));
  Renew(&look->workers,
        absl::StrCat("{\"workers\":[", absl::StrJoin(workers, ","),
                     "],\"more\":", request.page_token().empty() ? "false" : "true", "}"),
        look->number);
  return absl::OkStatus();
}

absl::Status LookAtServer(const FarmCalls& calls, const v1::PageSession& session, FarmLook* look) {
  v1::ServerStatus server;
  if (absl::Status status = calls.Call(session, "GetServerStatus", v1::GetServerStatusRequest(), &server);
      !status.ok())
    return status;
  // It changes with every block that is written; a page needs it to some megabytes.
  constexpr uint64_t kStep = uint64_t{1} << 26;
  server.set_free_bytes(server.free_bytes() / kStep * kStep);
  Renew(&look->server, rpc::JsonOf(server), look->number);
  return absl::OkStatus();
}

}  // namespace

std::string EventsSince(uint64_t has, const FarmLook& look) {
  std::string events;
  const auto add = [&events, has](const char* name, const FarmLook::Part& part) {
    if (part.changed > has) absl::StrAppend(&events, EventOf(name, part.json));
  };
  add("server", look.server);
  add("workers", look.workers);
  add("jobs", look.ids);
  for (const std::string& id : look.order) add("job", look.jobs.at(id));
  return events;
}

std::shared_ptr<FarmView::Shared> FarmView::SharedOf(const v1::PageSession& session, size_t* count) {
  const absl::Time now = rpc::MonotonicNow();
  absl::MutexLock lock(&mutex_);
  std::erase_if(shared_, [now](const auto& entry) { return now - entry.second->used > kMemory; });
  std::shared_ptr<Shared>& shared = shared_[absl::StrCat(session.credential(), "/", session.job_id())];
  if (shared == nullptr) shared = std::make_shared<Shared>();
  shared->used = now;
  *count = shared_.size();
  return shared;
}

FarmLook FarmView::LookAgain(const v1::PageSession& session, const FarmLook& last) const {
  FarmLook look = last;
  ++look.number;
  look.status = LookAtJobs(calls_, session, &look);
  if (session.job_id().empty()) {
    if (look.status.ok()) look.status = LookAtWorkers(calls_, session, &look);
    if (look.status.ok()) look.status = LookAtServer(calls_, session, &look);
  }
  return look;
}

std::shared_ptr<const FarmLook> FarmView::Look(const v1::PageSession& session) {
  size_t count = 0;
  const std::shared_ptr<Shared> shared = SharedOf(session, &count);
  absl::MutexLock lock(&shared->mutex);
  const absl::Time start = rpc::MonotonicNow();
  if (shared->last != nullptr && start < shared->next) return shared->last;
  shared->last = std::make_shared<const FarmLook>(
      LookAgain(session, shared->last != nullptr ? *shared->last : FarmLook()));
  const absl::Time end = rpc::MonotonicNow();
  const absl::Duration pause = (end - start) * (static_cast<double>(count) / options_.duty);
  shared->next = end + std::max(options_.interval, pause);
  return shared->last;
}

}  // namespace lumifold::page
