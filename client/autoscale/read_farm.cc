#include "client/autoscale/read_farm.h"

#include <algorithm>
#include <map>
#include <set>

#include "absl/strings/str_cat.h"

namespace lumifold::autoscale {
namespace {

constexpr int kPageWorkers = 1000;  // the coordinator's limit

FarmWorker::State StateOf(const v1::WorkerStatus& worker) {
  switch (worker.state()) {
    case v1::WORKER_STATE_IDLE:
      return FarmWorker::State::kIdle;
    case v1::WORKER_STATE_BLOCKED:
      return FarmWorker::State::kUseless;
    default:  // one that drains, is silent or set aside may hold units
      return FarmWorker::State::kBusy;
  }
}

std::vector<UserQueue> UsersOf(const v1::ServerStatus& status, const std::vector<std::string>& tags) {
  const std::set<std::string> have(tags.begin(), tags.end());
  std::map<int, UserQueue> users;
  int64_t own = 0;
  for (const v1::Demand& demand : status.demand()) {
    own += demand.units_queued() + demand.units_leased();
    const bool fits = std::all_of(demand.tags().begin(), demand.tags().end(),
                                  [&](const std::string& tag) { return have.contains(tag); });
    if (!fits) continue;
    users[demand.user()].queued += demand.units_queued();
    users[demand.user()].leased += demand.units_leased();
  }
  std::vector<UserQueue> queues;
  for (const auto& [user, queue] : users) queues.push_back(queue);
  // Of the other coordinators of the farm only the sum is known.
  int64_t all = 0;
  for (const v1::CoordinatorStatus& coordinator : status.coordinators()) all += coordinator.demand();
  if (all > own) queues.push_back({.queued = all - own});
  return queues;
}

}  // namespace

absl::StatusOr<FarmState> ReadFarm(client::FarmClient& farm, const std::vector<std::string>& tags) {
  const absl::StatusOr<v1::ServerStatus> status = farm.GetServerStatus();
  if (!status.ok()) return status.status();
  if (!status->storage_error().empty())
    return absl::UnavailableError(
        absl::StrCat("the coordinator grants no leases: ", status->storage_error()));
  FarmState state{.users = UsersOf(*status, tags), .workers = {}};
  v1::ListWorkersRequest request;
  request.set_limit(kPageWorkers);
  do {
    const absl::StatusOr<v1::ListWorkersResponse> page = farm.ListWorkers(request);
    if (!page.ok()) return page.status();
    for (const v1::WorkerStatus& worker : page->workers()) {
      if (worker.worker_id().empty()) continue;  // blocked, and not connected
      state.workers.push_back({.id = worker.worker_id(),
                               .process = worker.process().empty() ? worker.name() : worker.process(),
                               .state = StateOf(worker),
                               .slots = std::max(1, worker.slots()),
                               .units_done = worker.units_done(),
                               .seconds_per_unit = worker.seconds_per_unit()});
    }
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return state;
}

}  // namespace lumifold::autoscale
