#include "client/autoscale/policy/policy.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace lumifold::autoscale {
namespace {

/// Time of a unit that nobody has measured: plans size units so that they take no less.
constexpr double kLeastUnitSeconds = 2;
/// A worker is started only if the budget lets all workers run for so long: starting and loading a scene cost
/// tens of seconds. Half of it uses more of the budget's last minutes; twice of it wastes fewer starts.
constexpr absl::Duration kWorthStarting = absl::Minutes(5);
constexpr double kSecondsPerHour = 3600;

bool IsWorkerOf(const FarmWorker& worker, const Request& request) {
  const std::string& name = request.worker_name;
  return worker.process.starts_with(name) &&
         (worker.process.size() == name.size() || worker.process[name.size()] == ':' ||
          worker.process[name.size()] == '@');
}

bool Counts(const Request& request) {
  return !request.duplicate &&
         (request.state == Request::State::kPending || request.state == Request::State::kRunning);
}

/// One step of the policy: the arguments of Decide, and what was derived from them so far.
class Step {
 public:
  Step(absl::Time now, const FarmState& farm, const EngineState& engine, const Limits& limits,
       const Tuning& tuning, History* history)
      : now_(now), farm_(farm), engine_(engine), limits_(limits), tuning_(tuning), history_(*history) {}

  Decision Run() {
    MatchWorkers();
    ChargeRequests(now_, engine_, limits_, &history_);
    CountDeaths(now_, engine_, tuning_, &history_);
    Count();
    FindWanted();
    if (IsBudgetSpent()) {
      ReleaseAll();
    } else {
      ReleaseUseless();
      ReleaseSurplus();
      Start();
    }
    Explain();
    return std::move(decision_);
  }

 private:
  void MatchWorkers();
  void Count();
  double SecondsPerUnit();
  int Slots() const;
  void FindWanted();
  bool IsBudgetSpent() const;
  int Affordable() const;
  void ReleaseAll();
  void ReleaseUseless();
  void ReleaseSurplus();
  /// Whether a request that was started after the last failure is pending, or may still die.
  bool IsTrying(const Backoff& backoff) const;
  void Start();
  void Explain();

  void ReleaseOne(const Request& request, const std::string& why) {
    decision_.release.push_back({request.id, why});
    if (!Counts(request)) return;
    --active_;
    if (request.state == Request::State::kPending) --pending_left_;
  }
  const Request* RequestOf(const FarmWorker& worker) const;

  const absl::Time now_;
  const FarmState& farm_;
  const EngineState& engine_;
  const Limits& limits_;
  const Tuning& tuning_;
  History& history_;
  std::map<std::string, const FarmWorker*> worker_of_;  // by request
  int others_slots_ = 0;                                // of workers that no request has made
  int others_ = 0;
  int active_ = 0;        // requests that count and are not released
  int pending_left_ = 0;  // those of them that are pending
  std::string obstacle_;
  Decision decision_;
};

const Request* Step::RequestOf(const FarmWorker& worker) const {
  for (const Request& request : engine_.requests) {
    if (request.state == Request::State::kRunning && IsWorkerOf(worker, request)) return &request;
  }
  return nullptr;
}

void Step::MatchWorkers() {
  for (const FarmWorker& worker : farm_.workers) {
    if (const Request* request = RequestOf(worker); request != nullptr) {
      worker_of_[request->id] = &worker;
    } else if (worker.state != FarmWorker::State::kUseless) {
      ++others_;
      others_slots_ += worker.slots;
    }
  }
  History::Seen seen;
  for (const Request& request : engine_.requests) {
    const auto found = worker_of_.find(request.id);
    const bool joined = found != worker_of_.end();
    if (joined || history_.seen.joined.contains(request.id)) seen.joined.insert(request.id);
    if (request.state != Request::State::kRunning) continue;
    if (joined && found->second->state != FarmWorker::State::kBusy) seen.idle_since[request.id] = now_;
    if (!joined) seen.absent_since[request.id] = now_;
  }
  for (auto [now, before] : {std::pair(&seen.idle_since, &history_.seen.idle_since),
                             std::pair(&seen.absent_since, &history_.seen.absent_since)}) {
    for (auto& [id, since] : *now) {
      if (const auto earlier = before->find(id); earlier != before->end()) since = earlier->second;
    }
  }
  history_.seen = std::move(seen);
}

void Step::Count() {
  for (const Request& request : engine_.requests) {
    if (!Counts(request)) continue;
    ++(request.state == Request::State::kPending ? decision_.pending : decision_.running);
  }
  active_ = decision_.pending + decision_.running;
  pending_left_ = decision_.pending;
}

double Step::SecondsPerUnit() {
  double units = 0;
  double seconds = 0;
  for (const FarmWorker& worker : farm_.workers) {
    units += static_cast<double>(worker.units_done);
    seconds += static_cast<double>(worker.units_done) * worker.seconds_per_unit;
  }
  if (units > 0 && seconds > 0) history_.seconds_per_unit = seconds / units;
  return history_.seconds_per_unit > 0 ? history_.seconds_per_unit : kLeastUnitSeconds;
}

int Step::Slots() const {
  int slots = 0;
  for (const auto& [id, worker] : worker_of_) slots += worker->slots;
  const int workers = static_cast<int>(worker_of_.size());
  return workers == 0 ? tuning_.slots_per_worker : std::max(1, slots / workers);
}

void Step::FindWanted() {
  const double seconds = SecondsPerUnit();
  const double slots = Slots();
  const double share_of_time = std::min(1.0, seconds / absl::ToDoubleSeconds(tuning_.finish_within));
  double workers = 0;
  int64_t queued = 0;
  int64_t leased = 0;
  for (const UserQueue& user : farm_.users) {
    queued += user.queued;
    leased += user.leased;
    const double of_user = static_cast<double>(user.queued + user.leased) / slots * share_of_time;
    workers += limits_.per_user > 0 ? std::min<double>(of_user, limits_.per_user) : of_user;
  }
  workers -= others_slots_ / slots;
  constexpr double kMost = 1e9;  // the conversion is defined
  const int needed = static_cast<int>(std::ceil(std::clamp(workers, 0.0, kMost)));
  decision_.wanted = std::clamp(needed, limits_.minimum, limits_.maximum);
  decision_.reason =
      absl::StrFormat("%d units queued, %d leased, %.3g s each%s, %g slots a worker", queued, leased, seconds,
                      history_.seconds_per_unit > 0 ? "" : " (assumed)", slots);
  if (others_ > 0) absl::StrAppendFormat(&decision_.reason, ", %d workers from elsewhere", others_);
  absl::StrAppendFormat(&decision_.reason, ": %d workers needed", needed);
  if (needed != decision_.wanted)
    absl::StrAppendFormat(&decision_.reason, ", %d by the %s", decision_.wanted,
                          needed > decision_.wanted ? "maximum" : "minimum");
  absl::StrAppendFormat(&decision_.reason, "; %d running, %d pending", decision_.running, decision_.pending);
}

bool Step::IsBudgetSpent() const {
  return limits_.budget_core_hours > 0 &&
         history_.UsedCoreSeconds() >= limits_.budget_core_hours * kSecondsPerHour;
}

int Step::Affordable() const {
  if (limits_.budget_core_hours <= 0) return std::numeric_limits<int>::max();
  const double left = limits_.budget_core_hours * kSecondsPerHour - history_.UsedCoreSeconds();
  const double worker = tuning_.cores_per_worker * absl::ToDoubleSeconds(kWorthStarting);
  return static_cast<int>(std::clamp(left / worker, 0.0, 1e9)) - active_;
}

void Step::ReleaseAll() {
  obstacle_ = absl::StrFormat("the budget of %g core-hours is spent", limits_.budget_core_hours);
  for (const Request& request : engine_.requests) {
    if (Counts(request) || (request.duplicate && request.state == Request::State::kPending))
      ReleaseOne(request, "the budget is spent");
  }
}

void Step::ReleaseUseless() {
  // Connected workers whose names tell no request may be those of the requests without a worker.
  const bool names_tell = others_ < static_cast<int>(history_.seen.absent_since.size());
  for (const Request& request : engine_.requests) {
    const auto worker = worker_of_.find(request.id);
    const auto absent = history_.seen.absent_since.find(request.id);
    if (request.duplicate && request.state == Request::State::kPending) {
      ReleaseOne(request, "another request has its place");
    } else if (request.state == Request::State::kRunning && worker != worker_of_.end() &&
               worker->second->state == FarmWorker::State::kUseless) {
      ReleaseOne(request, "its worker is blocked");
    } else if (names_tell && absent != history_.seen.absent_since.end() &&
               now_ - absent->second >= tuning_.join_within) {
      const std::string why =
          absl::StrCat("request ", request.id, " runs, but its worker has not joined for ",
                       absl::FormatDuration(tuning_.join_within));
      ReleaseOne(request, why);
      history_.deaths.Fail(now_, why);
    }
  }
}

void Step::ReleaseSurplus() {
  int surplus = active_ - decision_.wanted;
  for (const Request& request : engine_.requests) {
    if (surplus > 0 && Counts(request) && request.state == Request::State::kPending) {
      ReleaseOne(request, "not needed any more");
      --surplus;
    }
  }
  std::vector<std::pair<absl::Time, const Request*>> idle;
  for (const Request& request : engine_.requests) {
    const auto since = history_.seen.idle_since.find(request.id);
    const auto worker = worker_of_.find(request.id);
    if (since != history_.seen.idle_since.end() && now_ - since->second >= tuning_.idle &&
        worker->second->state == FarmWorker::State::kIdle)
      idle.emplace_back(since->second, &request);
  }
  std::sort(idle.begin(), idle.end(), [](const auto& a, const auto& b) {
    return std::pair(a.first, a.second->id) < std::pair(b.first, b.second->id);
  });
  for (const auto& [since, request] : idle) {
    if (surplus-- <= 0) return;
    ReleaseOne(*request, absl::StrCat("idle for ", absl::FormatDuration(now_ - since)));
  }
}

bool Step::IsTrying(const Backoff& backoff) const {
  return pending_left_ > 0 ||
         std::any_of(engine_.requests.begin(), engine_.requests.end(), [&](const Request& request) {
           return request.state == Request::State::kRunning && request.started > backoff.last &&
                  now_ - request.started <= tuning_.start_time;
         });
}

void Step::Start() {
  int missing = decision_.wanted - active_;
  if (missing <= 0) return;
  for (const auto& [what, backoff] : {std::pair("the engine refused: ", &history_.refusals),
                                      std::pair("workers die at their start: ", &history_.deaths)}) {
    if (backoff->failures == 0) continue;
    const absl::Duration left = backoff->NextTry(tuning_) - now_;
    obstacle_ = absl::StrFormat("%s%s (%d in a row)", what, backoff->why, backoff->failures);
    if (left > absl::ZeroDuration()) {
      absl::StrAppend(&obstacle_, "; next try in ", absl::FormatDuration(absl::Ceil(left, absl::Seconds(1))));
      return;
    }
    // One at a time until it lives.
    missing = IsTrying(*backoff) ? 0 : std::min(missing, 1);
  }
  const int affordable = std::max(0, Affordable());
  if (affordable < missing)
    obstacle_ = absl::StrFormat("%.3g of %g core-hours are left",
                                limits_.budget_core_hours - history_.UsedCoreSeconds() / kSecondsPerHour,
                                limits_.budget_core_hours);
  decision_.start = std::min({missing, affordable, tuning_.starts_at_a_time});
}

void Step::Explain() {
  if (decision_.start > 0) absl::StrAppend(&decision_.reason, "; starts ", decision_.start);
  if (!decision_.release.empty()) absl::StrAppend(&decision_.reason, "; releases ", decision_.release.size());
  for (const Request& request : engine_.requests) {
    if (request.state != Request::State::kPending || request.detail.empty()) continue;
    absl::StrAppend(&decision_.reason, "; request ", request.id, " waits: ", request.detail);
    break;
  }
  if (!obstacle_.empty()) absl::StrAppend(&decision_.reason, "; ", obstacle_);
}

}  // namespace

Decision Decide(absl::Time now, const FarmState& farm, const EngineState& engine, const Limits& limits,
                const Tuning& tuning, History* history) {
  return Step(now, farm, engine, limits, tuning, history).Run();
}

void OnStarted(History* history) { history->refusals = Backoff(); }

void OnRefused(absl::Time now, const std::string& error, History* history) {
  history->refusals.Fail(now, error);
}

}  // namespace lumifold::autoscale
