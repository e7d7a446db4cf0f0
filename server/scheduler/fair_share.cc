#include "server/scheduler/fair_share.h"

#include <algorithm>
#include <cmath>

#include "filter/image/check.h"

namespace lumifold::scheduler {
namespace {

/// A priority that is ten higher doubles the share.
constexpr double kPrioritiesPerOctave = 10;

/// Usage by which an account may be ahead of the virtual time: more than what locality allows, or a worker
/// would never leave a job of low weight.
constexpr double kMaxAheadSeconds = 2 * FairShare::kSlotSeconds;

}  // namespace

double FairShare::WeightOf(int priority) { return std::exp2(priority / kPrioritiesPerOctave); }

void FairShare::Charge(double seconds, double virtual_time, Account* account) {
  const double most = virtual_time * account->weight + std::max(kMaxAheadSeconds, 2 * seconds);
  account->usage = std::max(account->usage, std::min(account->usage + seconds, most));
}

bool FairShare::Lift(double virtual_time, double slack, Account* account) {
  const double least = virtual_time * account->weight - slack;
  if (account->usage >= least) return false;
  account->usage = least;
  return true;
}

void FairShare::SetWeight(double weight, Account* account) {
  account->usage *= weight / account->weight;
  account->weight = weight;
}

void FairShare::AddJob(int64_t number, const std::string& user, int priority) {
  const auto [it, is_new] = user_numbers_.emplace(user, next_user_);
  if (is_new) users_[next_user_++].name = user;
  const auto [job, is_new_job] = jobs_.try_emplace(number);
  LUMIFOLD_CHECK(is_new_job);
  job->second.user = it->second;
  job->second.priority = priority;
  job->second.account.weight = WeightOf(priority);
  users_.at(it->second).priorities.insert(priority);
  UpdateWeight(it->second);
}

void FairShare::RemoveJob(int64_t number) {
  Job& job = jobs_.at(number);
  Leave(number, job);
  User& user = users_.at(job.user);
  user.priorities.erase(user.priorities.find(job.priority));
  user.account.held -= job.account.held;
  if (user.priorities.empty()) {
    user_numbers_.erase(user.name);
    users_.erase(job.user);
  } else {
    UpdateWeight(job.user);
  }
  jobs_.erase(number);
}

void FairShare::UpdateWeight(int64_t number) {
  User& user = users_.at(number);
  SetWeight(WeightOf(*user.priorities.rbegin()), &user.account);
  Reorder(number, user);
}

void FairShare::SetPriority(int64_t number, int priority) {
  Job& job = jobs_.at(number);
  User& user = users_.at(job.user);
  user.priorities.erase(user.priorities.find(job.priority));
  user.priorities.insert(priority);
  job.priority = priority;
  SetWeight(WeightOf(priority), &job.account);
  Reorder(number, job);
  UpdateWeight(job.user);
}

void FairShare::SetQueue(int64_t number, Queue* queue, absl::Time now) {
  Job& job = jobs_.at(number);
  if (job.queue == queue) return;
  const bool was_ready = job.queue != nullptr;
  Leave(number, job);
  job.queue = queue;
  if (queue == nullptr) return;
  if (!was_ready) job.waits_since = now;
  Enter(number, job, was_ready);
}

void FairShare::Enter(int64_t number, Job& job, bool was_ready) {
  User& user = users_.at(job.user);
  if (!was_ready) {
    if (user.ready.empty() && Lift(virtual_time_, 0, &user.account)) Reorder(job.user, user);
    Lift(user.virtual_time, 0, &job.account);
    job.account.key = job.account.Key();
  }
  auto& jobs = user.ready[job.queue];
  if (jobs.empty()) job.queue->users_.emplace(user.account.key, job.user);
  jobs.emplace(job.account.key, number);
  job.queue->waiting_.emplace(job.waits_since, number);
}

void FairShare::Leave(int64_t number, Job& job) {
  if (job.queue == nullptr) return;
  User& user = users_.at(job.user);
  const auto ready = user.ready.find(job.queue);
  ready->second.erase({job.account.key, number});
  job.queue->waiting_.erase({job.waits_since, number});
  if (ready->second.empty()) {
    job.queue->users_.erase({user.account.key, job.user});
    user.ready.erase(ready);
  }
  job.queue = nullptr;
}

void FairShare::Reorder(int64_t number, User& user) {
  const double before = std::exchange(user.account.key, user.account.Key());
  if (user.account.key == before) return;
  for (const auto& [queue, jobs] : user.ready) {
    queue->users_.erase({before, number});
    queue->users_.emplace(user.account.key, number);
  }
}

void FairShare::Reorder(int64_t number, Job& job) {
  const double before = std::exchange(job.account.key, job.account.Key());
  if (job.account.key == before || job.queue == nullptr) return;
  auto& jobs = users_.at(job.user).ready.at(job.queue);
  jobs.erase({before, number});
  jobs.emplace(job.account.key, number);
}

void FairShare::Choose(const Candidate& first) {
  const Job& job = jobs_.at(first.job);
  User& user = users_.at(job.user);
  virtual_time_ = std::max(virtual_time_, user.account.VirtualTime());
  user.virtual_time = std::max(user.virtual_time, job.account.VirtualTime());
}

void FairShare::Granted(int64_t number, absl::Time now) {
  Job& job = jobs_.at(number);
  User& user = users_.at(job.user);
  ++user.account.held;
  ++job.account.held;
  Reorder(job.user, user);
  Reorder(number, job);
  if (job.queue != nullptr) job.queue->waiting_.erase({job.waits_since, number});
  job.waits_since = now;
  if (job.queue != nullptr) job.queue->waiting_.emplace(job.waits_since, number);
}

void FairShare::Ended(int64_t number, absl::Duration slot_time) {
  Job& job = jobs_.at(number);
  User& user = users_.at(job.user);
  const double seconds = absl::ToDoubleSeconds(slot_time);
  --user.account.held;
  --job.account.held;
  Charge(seconds, virtual_time_, &user.account);
  Charge(seconds, user.virtual_time, &job.account);
  Reorder(job.user, user);
  Reorder(number, job);
}

std::optional<FairShare::Candidate> FairShare::First(Queue& queue, const std::set<int64_t>& passed) {
  while (!queue.users_.empty()) {  // whoever could not be served for long has no claim on that time
    const int64_t first = queue.users_.begin()->second;
    User& user = users_.at(first);
    if (!Lift(virtual_time_, kSlotSeconds, &user.account)) break;
    Reorder(first, user);
  }
  for (const auto& [key, number] : queue.users_) {
    for (const auto& job : users_.at(number).ready.at(&queue)) {
      if (!passed.contains(job.second)) return Candidate{job.second, {key, number}, job};
    }
  }
  return std::nullopt;
}

bool FairShare::IsNear(int64_t number, const Candidate& first, const Tolerance& tolerance) const {
  const Job& job = jobs_.at(number);
  const User& user = users_.at(job.user);
  const auto is_near = [&](const Account& account, double least, double part) {
    const double ahead = (account.key - least) * account.weight / kSlotSeconds;
    return ahead <= std::max(tolerance.slots, part * static_cast<double>(account.held));
  };
  return is_near(user.account, first.user_key.first, tolerance.user_part) &&
         is_near(job.account, user.ready.at(job.queue).begin()->first, tolerance.job_part);
}

double FairShare::ShareOfUser(int64_t number) const {
  const int64_t own = jobs_.at(number).user;
  double sum = 0;
  for (const auto& [user_number, user] : users_) {
    if (user_number == own || !user.ready.empty()) sum += user.account.weight;
  }
  return users_.at(own).account.weight / sum;
}

std::optional<std::pair<absl::Time, int64_t>> FairShare::LongestWaiting(const Queue& queue) {
  return queue.waiting_.empty() ? std::nullopt : std::optional(*queue.waiting_.begin());
}

}  // namespace lumifold::scheduler
