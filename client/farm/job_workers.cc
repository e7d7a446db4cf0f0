#include "client/farm/job_workers.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/reports/farm_report.h"

namespace lumifold::client {
namespace {

constexpr absl::Duration kInterval = absl::Seconds(1);
constexpr int kPageWorkers = 1000;  // the coordinator's limit

/// What people call it: a worker's certificate may be that of several processes.
const std::string& NameOf(const v1::WorkerStatus& worker) {
  return worker.process().empty() ? worker.name() : worker.process();
}

std::string LineOf(const v1::WorkerStatus& worker) {
  std::string line =
      absl::StrFormat("%-24s  %d of %d units", NameOf(worker), worker.leases(), worker.slots());
  if (worker.units_done() > 0)
    absl::StrAppendFormat(&line, ", %.2f s a unit, %d done", worker.seconds_per_unit(), worker.units_done());
  if (worker.units_failed() > 0) absl::StrAppend(&line, ", ", worker.units_failed(), " failed");
  if (worker.state() != v1::WORKER_STATE_BUSY) absl::StrAppend(&line, ", ", WorkerStateName(worker.state()));
  return line;
}

}  // namespace

std::vector<std::string> WorkerLines(const std::string& job_id,
                                     const std::vector<v1::WorkerStatus>& workers) {
  std::vector<std::string> lines;
  for (const v1::WorkerStatus& worker : workers) {
    const auto& jobs = worker.job_ids();
    if (std::find(jobs.begin(), jobs.end(), job_id) != jobs.end()) lines.push_back(LineOf(worker));
  }
  std::sort(lines.begin(), lines.end());
  if (lines.size() > kMaxWorkerLines) {
    const size_t others = lines.size() - (kMaxWorkerLines - 1);
    lines.resize(kMaxWorkerLines - 1);
    lines.push_back(absl::StrCat("and ", others, " more workers"));
  }
  return lines;
}

JobWorkers::JobWorkers(std::unique_ptr<FarmClient> farm, std::string job_id)
    : farm_(std::move(farm)), job_id_(std::move(job_id)), thread_([this] { Run(); }) {}

JobWorkers::~JobWorkers() {
  stop_.Notify();
  thread_.join();
}

std::vector<std::string> JobWorkers::Lines() const {
  absl::MutexLock lock(&mutex_);
  return lines_;
}

void JobWorkers::Run() {
  do {
    std::vector<v1::WorkerStatus> workers;
    v1::ListWorkersRequest request;
    request.set_limit(kPageWorkers);
    request.set_job_id(job_id_);
    do {
      const absl::StatusOr<v1::ListWorkersResponse> page = farm_->ListWorkers(request);
      if (absl::IsPermissionDenied(page.status()) || absl::IsUnauthenticated(page.status())) return;
      if (!page.ok()) break;
      workers.insert(workers.end(), page->workers().begin(), page->workers().end());
      request.set_page_token(page->next_page_token());
    } while (!request.page_token().empty());
    std::vector<std::string> lines = WorkerLines(job_id_, workers);
    absl::MutexLock lock(&mutex_);
    lines_ = std::move(lines);
  } while (!stop_.WaitFor(kInterval));
}

void ProgressWithWorkers::Update(const ProgressState& state) {
  ProgressState with_workers = state;
  with_workers.lines = workers_.Lines();
  progress_.Update(with_workers);
}

}  // namespace lumifold::client
