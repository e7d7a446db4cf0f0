#include "server/scheduler/worker_health.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::scheduler {

using job::WorkerId;

WorkerHealth::WorkerHealth(const SchedulerOptions& options, WorkerPool* workers)
    : max_attributed_jobs_(options.max_attributed_jobs), cool_down_(options.cool_down), workers_(workers) {}

void WorkerHealth::Attribute(WorkerId worker, int64_t job, absl::Time now) {
  const Worker* state = workers_->Find(worker);
  if (state == nullptr || state->IsCooling()) return;
  std::map<int64_t, absl::Time>& jobs = attributed_[worker];
  std::erase_if(jobs, [&](const auto& entry) { return entry.second + cool_down_ <= now; });
  jobs[job] = now;
  if (static_cast<int>(jobs.size()) < max_attributed_jobs_) return;
  // A fault that all workers share, such as of the network, must not empty the farm.
  const KindCounts like = workers_->Count(Requirement::Of(state->traits.numeric_class, {}));
  if (like.cooling + 1 >= like.available) return;
  const absl::Time until = now + cool_down_;
  workers_->Change(worker, [until](Worker& changed) { changed.cools_until = until; });
  cooling_.push_back({worker, until, CoolDownReason(worker)});
}

void WorkerHealth::EndCoolDown(WorkerId worker) {
  workers_->Change(worker, [](Worker& state) { state.cools_until = absl::InfinitePast(); });
  attributed_.erase(worker);
}

void WorkerHealth::EndCoolDowns(absl::Time now) {
  for (const WorkerId worker : workers_->Cooled(now)) EndCoolDown(worker);
}

std::string WorkerHealth::CoolDownReason(WorkerId worker) const {
  const Worker* state = workers_->Find(worker);
  if (state == nullptr || !state->IsCooling()) return "";
  return absl::StrCat("it failed units of ", attributed_.at(worker).size(),
                      " jobs that other workers rendered");
}

std::vector<CoolingWorker> WorkerHealth::TakeCooling() { return std::exchange(cooling_, {}); }

void WorkerHealth::Block(const std::string& name, const std::string& reason) {
  blocked_[name] = reason;
  for (const WorkerId worker : workers_->Named(name))
    workers_->Change(worker, [](Worker& state) { state.blocked = true; });
}

bool WorkerHealth::Readmit(const std::string& name) {
  const bool was_blocked = blocked_.erase(name) > 0;
  const std::vector<WorkerId> connected = workers_->Named(name);
  for (const WorkerId worker : connected) {
    workers_->Change(worker, [](Worker& state) {
      state.blocked = false;
      state.draining = false;
    });
    EndCoolDown(worker);
  }
  return was_blocked || !connected.empty();
}

void WorkerHealth::AddFaulty(FaultyWorker faulty) { faulty_.push_back(std::move(faulty)); }

std::vector<FaultyWorker> WorkerHealth::TakeFaulty() { return std::exchange(faulty_, {}); }

}  // namespace lumifold::scheduler
