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

void FairShare::AddJob(int64_t number, const std::string& user, int priority, int64_t turn) {
  const auto [it, is_new] = user_numbers_.emplace(user, next_user_);
  if (is_new) users_[next_user_++].name = user;
  const auto [job, is_new_job] =
      jobs_.try_emplace(number, Job{.user = it->second, .priority = priority, .turn = turn});
  LUMIFOLD_CHECK(is_new_job);
  JoinBand(job->second);
  UpdateWeight(it->second);
}

void FairShare::RemoveJob(int64_t number) {
  Job& job = jobs_.at(number);
  Leave(number, job);
  User& user = OwnerOf(job);
  user.account.held -= job.held;
  LeaveBand(job);
  if (user.bands.empty()) {
    user_numbers_.erase(user.name);
    users_.erase(job.user);
  } else {
    UpdateWeight(job.user);
  }
  jobs_.erase(number);
}

void FairShare::JoinBand(const Job& job) {
  const auto [band, is_new] = OwnerOf(job).bands.try_emplace(job.priority);
  if (is_new) band->second.account.weight = WeightOf(job.priority);
  ++band->second.jobs;
  band->second.account.held += job.held;
  Reorder(job.priority, band->second, OwnerOf(job));
}

void FairShare::LeaveBand(const Job& job) {
  User& user = OwnerOf(job);
  Band& band = BandOf(job, user);
  band.account.held -= job.held;
  Reorder(job.priority, band, user);
  if (--band.jobs == 0) user.bands.erase(job.priority);
}

void FairShare::UpdateWeight(int64_t number) {
  User& user = users_.at(number);
  SetWeight(WeightOf(user.bands.rbegin()->first), &user.account);
  Reorder(number, user);
}

void FairShare::SetPriority(int64_t number, int priority) {
  Job& job = jobs_.at(number);
  if (job.priority == priority) return;
  Queue* const queue = job.queue;
  const absl::Time waits_since = Leave(number, job);
  const int before = std::exchange(job.priority, priority);
  JoinBand(job);
  job.priority = before;
  LeaveBand(job);
  job.priority = priority;
  UpdateWeight(job.user);
  job.queue = queue;
  if (queue != nullptr) Enter(number, job, /*was_ready=*/false, waits_since);
}

void FairShare::SetTurn(int64_t number, int64_t turn) {
  Job& job = jobs_.at(number);
  Queue* const queue = job.queue;
  const absl::Time waits_since = Leave(number, job);
  job.turn = turn;
  job.queue = queue;
  if (queue != nullptr) Enter(number, job, /*was_ready=*/true, waits_since);
}

void FairShare::SetQueue(int64_t number, Queue* queue, absl::Time now) {
  Job& job = jobs_.at(number);
  if (job.queue == queue) return;
  const bool was_ready = job.queue != nullptr;
  const absl::Time waits_since = was_ready ? Leave(number, job) : now;
  job.queue = queue;
  if (queue != nullptr) Enter(number, job, was_ready, waits_since);
}

void FairShare::Enter(int64_t number, const Job& job, bool was_ready, absl::Time waits_since) {
  User& user = OwnerOf(job);
  Band& band = BandOf(job, user);
  if (!was_ready && user.ready.empty() && Lift(virtual_time_, 0, &user.account)) Reorder(job.user, user);
  if (!was_ready && band.ready.empty()) {
    Lift(user.virtual_time, 0, &band.account);
    band.account.key = band.account.Key();
  }
  const auto [ready, is_first] = band.ready.try_emplace(job.queue);
  ready->second.jobs.emplace(job.turn, number);
  if (!is_first) return;
  ready->second.waits_since = waits_since;
  job.queue->waiting_.emplace(waits_since, Queue::Band(job.user, job.priority));
  std::set<std::pair<double, int>>& bands = user.ready[job.queue];
  if (bands.empty()) job.queue->users_.emplace(user.account.key, job.user);
  bands.emplace(band.account.key, job.priority);
}

absl::Time FairShare::Leave(int64_t number, Job& job) {
  if (job.queue == nullptr) return absl::InfiniteFuture();
  Queue* const queue = std::exchange(job.queue, nullptr);
  User& user = OwnerOf(job);
  Band& band = BandOf(job, user);
  const auto ready = band.ready.find(queue);
  const absl::Time waits_since = ready->second.waits_since;
  ready->second.jobs.erase({job.turn, number});
  if (!ready->second.jobs.empty()) return waits_since;
  band.ready.erase(ready);
  queue->waiting_.erase({waits_since, Queue::Band(job.user, job.priority)});
  const auto bands = user.ready.find(queue);
  bands->second.erase({band.account.key, job.priority});
  if (bands->second.empty()) {
    queue->users_.erase({user.account.key, job.user});
    user.ready.erase(bands);
  }
  return waits_since;
}

void FairShare::Reorder(int64_t number, User& user) {
  const double before = std::exchange(user.account.key, user.account.Key());
  if (user.account.key == before) return;
  for (const auto& [queue, bands] : user.ready) {
    queue->users_.erase({before, number});
    queue->users_.emplace(user.account.key, number);
  }
}

void FairShare::Reorder(int priority, Band& band, User& user) {
  const double before = std::exchange(band.account.key, band.account.Key());
  if (band.account.key == before) return;
  for (const auto& [queue, ready] : band.ready) {
    std::set<std::pair<double, int>>& bands = user.ready.at(queue);
    bands.erase({before, priority});
    bands.emplace(band.account.key, priority);
  }
}

void FairShare::Choose(const Candidate& first) {
  const Job& job = jobs_.at(first.job);
  User& user = OwnerOf(job);
  virtual_time_ = std::max(virtual_time_, user.account.VirtualTime());
  user.virtual_time = std::max(user.virtual_time, BandOf(job, user).account.VirtualTime());
}

void FairShare::Granted(int64_t number, absl::Time now) {
  Job& job = jobs_.at(number);
  User& user = OwnerOf(job);
  Band& band = BandOf(job, user);
  ++user.account.held;
  ++band.account.held;
  ++job.held;
  Reorder(job.user, user);
  Reorder(job.priority, band, user);
  if (job.queue == nullptr) return;
  absl::Time& waits_since = band.ready.at(job.queue).waits_since;
  const Queue::Band waiting(job.user, job.priority);
  job.queue->waiting_.erase({waits_since, waiting});
  waits_since = now;
  job.queue->waiting_.emplace(waits_since, waiting);
}

void FairShare::Ended(int64_t number, absl::Duration slot_time) {
  Job& job = jobs_.at(number);
  User& user = OwnerOf(job);
  Band& band = BandOf(job, user);
  const double seconds = absl::ToDoubleSeconds(slot_time);
  --user.account.held;
  --band.account.held;
  --job.held;
  Charge(seconds, virtual_time_, &user.account);
  Charge(seconds, user.virtual_time, &band.account);
  Reorder(job.user, user);
  Reorder(job.priority, band, user);
}

std::optional<FairShare::Candidate> FairShare::First(Queue& queue, const std::set<int64_t>& passed) {
  while (!queue.users_.empty()) {  // whoever could not be served for long has no claim on that time
    const int64_t first = queue.users_.begin()->second;
    User& user = users_.at(first);
    if (!Lift(virtual_time_, kSlotSeconds, &user.account)) break;
    Reorder(first, user);
  }
  for (const std::pair<double, int64_t>& user_key : queue.users_) {
    const User& user = users_.at(user_key.second);
    for (const std::pair<double, int>& band_key : user.ready.at(&queue)) {
      for (const Turn& turn : user.bands.at(band_key.second).ready.at(&queue).jobs) {
        if (!passed.contains(turn.second)) return Candidate{turn.second, user_key, band_key, turn};
      }
    }
  }
  return std::nullopt;
}

bool FairShare::IsNear(int64_t number, const Candidate& first, const Tolerance& tolerance) const {
  const Job& job = jobs_.at(number);
  const User& user = users_.at(job.user);
  const Band& band = user.bands.at(job.priority);
  if (band.ready.at(job.queue).jobs.begin()->second != number) return false;
  if (first.user_key.second == job.user && first.band_key.second == job.priority) return false;
  const auto is_near = [&](const Account& account, double least, double part) {
    const double ahead = (account.key - least) * account.weight / kSlotSeconds;
    return ahead <= std::max(tolerance.slots, part * static_cast<double>(account.held));
  };
  return is_near(user.account, first.user_key.first, tolerance.user_part) &&
         is_near(band.account, user.ready.at(job.queue).begin()->first, tolerance.band_part);
}

double FairShare::ShareOfUser(int64_t number) const {
  const int64_t own = jobs_.at(number).user;
  double sum = 0;
  for (const auto& [user_number, user] : users_) {
    if (user_number == own || !user.ready.empty()) sum += user.account.weight;
  }
  return users_.at(own).account.weight / sum;
}

std::set<FairShare::Turn> FairShare::TurnsBefore(int64_t number) const {
  const Job& job = jobs_.at(number);
  std::set<Turn> before;
  for (const auto& [queue, ready] : users_.at(job.user).bands.at(job.priority).ready)
    before.insert(ready.jobs.begin(), ready.jobs.lower_bound({job.turn, number}));
  return before;
}

int64_t FairShare::FirstTurn(int64_t number) const {
  const Job& job = jobs_.at(number);
  int64_t first = job.turn;
  for (const auto& [other_number, other] : jobs_) {
    if (other.user == job.user && other.priority == job.priority) first = std::min(first, other.turn);
  }
  return first;
}

std::optional<std::pair<absl::Time, int64_t>> FairShare::LongestWaiting(Queue& queue) const {
  if (queue.waiting_.empty()) return std::nullopt;
  const auto& [since, waiting] = *queue.waiting_.begin();
  const Band& band = users_.at(waiting.first).bands.at(waiting.second);
  return std::pair(since, band.ready.at(&queue).jobs.begin()->second);
}

}  // namespace lumifold::scheduler
