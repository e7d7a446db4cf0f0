#include "server/coordinator/worker_table.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::server {

using job::WorkerId;

std::string PartyOf(const std::string& name, bool is_certified) {
  const size_t colon = name.rfind(':');
  const bool has_process = colon != std::string::npos && colon > 0 && colon + 1 < name.size() &&
                           name.find_first_not_of("0123456789", colon + 1) == std::string::npos;
  return !is_certified && has_process ? name.substr(0, colon) : name;
}

WorkerId WorkerTable::Add(ConnectedWorker worker) {
  const WorkerId id(next_worker_++);
  workers_.emplace(id, std::move(worker));
  return id;
}

ConnectedWorker* WorkerTable::Find(WorkerId worker) {
  const auto found = workers_.find(worker);
  return found == workers_.end() ? nullptr : &found->second;
}

const ConnectedWorker* WorkerTable::Find(WorkerId worker) const {
  const auto found = workers_.find(worker);
  return found == workers_.end() ? nullptr : &found->second;
}

std::string WorkerTable::NameOf(WorkerId worker) const {
  const ConnectedWorker* const found = Find(worker);
  const std::string id = job::TextOf(worker);
  return found == nullptr ? id : absl::StrCat(id, "/", found->name);
}

void WorkerTable::Send(WorkerId worker, const v1::CoordinatorMessage& message) const {
  if (const ConnectedWorker* const found = Find(worker); found != nullptr) found->sink->Send(message);
}

void WorkerTable::Acknowledge(WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                              const std::string& refused) const {
  v1::CoordinatorMessage message;
  *message.mutable_ack()->mutable_unit() = ProtoFromUnit(unit);
  message.mutable_ack()->set_attempt(attempt.value());
  message.mutable_ack()->set_refused(refused);
  Send(worker, message);
}

void WorkerTable::SendJobEnded(const job::JobId& job) {
  v1::CoordinatorMessage message;
  message.mutable_job_ended()->set_job_id(job.value());
  for (auto& [id, worker] : workers_) {
    if (worker.known_jobs.erase(job) > 0) worker.sink->Send(message);
  }
}

}  // namespace lumifold::server
