#include "tests/bench/autoscale_sim.h"

#include <algorithm>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "client/autoscale/policy/policy.h"

namespace lumifold::sim {
namespace {

using autoscale::Request;

constexpr int kStepSeconds = 15;
constexpr int kDeadAfterSeconds = 2;
constexpr int kKeptSeconds = 300;  // the engine shows ended requests for so long

struct SimWorker {
  Request request;
  int submitted = 0;
  int started = 0;
  int ended = 0;
  bool dies = false;
  int64_t units_done = 0;
  std::vector<int> units;  // seconds that are left of each

  bool Runs() const { return request.state == Request::State::kRunning; }
  bool Lives() const { return Runs() || request.state == Request::State::kPending; }
};

absl::Time At(int second) { return absl::UnixEpoch() + absl::Seconds(second); }

class Simulation {
 public:
  explicit Simulation(const AutoscaleCase& scenario) : scenario_(scenario) {}

  AutoscaleResult Run() {
    const int length = static_cast<int>(absl::ToInt64Seconds(scenario_.length));
    for (second_ = 0; second_ < length; ++second_) {
      queued_ += scenario_.submitted(second_);
      Take(scenario_.taken(second_));
      for (SimWorker& worker : workers_) Advance(&worker);
      for (SimWorker& worker : workers_) Render(&worker);
      if (second_ % kStepSeconds == 0) Step();
    }
    for (const SimWorker& worker : workers_) {
      if (worker.Runs()) result_.core_hours += (second_ - worker.started) / 3600.0;
    }
    return std::move(result_);
  }

 private:
  void End(SimWorker* worker, Request::End end) {
    if (worker->Runs()) result_.core_hours += (second_ - worker->started) / 3600.0;
    queued_ += static_cast<int>(worker->units.size());  // handed back, or leased again
    worker->units.clear();
    worker->request.state = Request::State::kEnded;
    worker->request.end = end;
    worker->request.ended = At(second_);
    worker->ended = second_;
    result_.gone_after =
        std::any_of(workers_.begin(), workers_.end(), [](const SimWorker& other) { return other.Lives(); })
            ? 0
            : second_;
  }

  void Take(int count) {
    for (SimWorker& worker : workers_) {
      if (count == 0 || !worker.Runs()) continue;
      --count;
      End(&worker, Request::End::kTaken);
      if (!scenario_.requeues) continue;
      worker.request.state = Request::State::kPending;
      worker.request.started = absl::InfiniteFuture();
      worker.request.ended = absl::InfiniteFuture();
      worker.submitted = second_;
    }
  }

  void Advance(SimWorker* worker) {
    if (worker->request.state == Request::State::kPending &&
        second_ - worker->submitted >= scenario_.pending_seconds) {
      worker->request.state = Request::State::kRunning;
      worker->request.started = At(second_);
      worker->started = second_;
      worker->dies = scenario_.deadly(second_);
    }
    if (worker->Runs() && worker->dies && second_ - worker->started >= kDeadAfterSeconds) {
      ++result_.deaths;
      End(worker, Request::End::kFailed);
    }
  }

  bool HasJoined(const SimWorker& worker) const {
    return worker.Runs() && second_ - worker.started >= scenario_.join_seconds;
  }

  void Render(SimWorker* worker) {
    if (!HasJoined(*worker)) return;
    for (int& left : worker->units) --left;
    const auto done = std::erase(worker->units, 0);
    worker->units_done += static_cast<int64_t>(done);
    result_.units_done += static_cast<int>(done);
    if (done > 0) result_.last_done = second_;
    while (queued_ > 0 && worker->units.size() < static_cast<size_t>(scenario_.tuning.slots_per_worker)) {
      worker->units.push_back(static_cast<int>(scenario_.unit_seconds));
      --queued_;
    }
  }

  autoscale::FarmState Farm() const {
    autoscale::FarmState farm;
    int64_t leased = 0;
    for (const SimWorker& worker : workers_) {
      if (!HasJoined(worker)) continue;
      leased += static_cast<int64_t>(worker.units.size());
      farm.workers.push_back({.id = worker.request.id,
                              .process = worker.request.worker_name,
                              .state = worker.units.empty() ? autoscale::FarmWorker::State::kIdle
                                                            : autoscale::FarmWorker::State::kBusy,
                              .slots = scenario_.tuning.slots_per_worker,
                              .units_done = worker.units_done,
                              .seconds_per_unit = scenario_.unit_seconds});
    }
    farm.users = {{.queued = queued_, .leased = leased}};
    return farm;
  }

  void Step() {
    autoscale::EngineState engine;
    for (const SimWorker& worker : workers_) {
      if (worker.Lives() || second_ - worker.ended < kKeptSeconds) engine.requests.push_back(worker.request);
    }
    const autoscale::Decision decision =
        Decide(At(second_), Farm(), engine, scenario_.limits, scenario_.tuning, &history_);
    result_.samples.push_back({.second = second_,
                               .wanted = decision.wanted,
                               .pending = decision.pending,
                               .running = decision.running,
                               .queued = queued_,
                               .started = result_.starts + result_.refused,
                               .reason = decision.reason});
    for (const autoscale::Release& release : decision.release) Release(release.id);
    if (decision.start > 0) Start(decision.start);
    const auto active =
        std::count_if(workers_.begin(), workers_.end(), [](const SimWorker& w) { return w.Lives(); });
    result_.most_active = std::max(result_.most_active, static_cast<int>(active));
    if (decision.start > 0)
      result_.most_needless = std::max(result_.most_needless, static_cast<int>(active) - decision.wanted);
  }

  void Release(const std::string& id) {
    for (SimWorker& worker : workers_) {
      if (worker.request.id != id || !worker.Lives()) continue;
      if (!worker.units.empty()) ++result_.busy_released;
      End(&worker, Request::End::kReleased);
    }
  }

  void Start(int count) {
    if (scenario_.refuses(second_)) {
      ++result_.refused;
      OnRefused(At(second_), "sbatch ended with 1: Job violates accounting/QOS policy", &history_);
      return;
    }
    OnStarted(&history_);
    for (int i = 0; i < count; ++i) {
      SimWorker worker;
      worker.request.id = absl::StrCat(++result_.starts);
      worker.request.worker_name = absl::StrCat("slurm-", worker.request.id);
      worker.request.cores = 1;
      worker.submitted = second_;
      workers_.push_back(std::move(worker));
    }
  }

  const AutoscaleCase& scenario_;
  int second_ = 0;
  int queued_ = 0;
  std::vector<SimWorker> workers_;
  autoscale::History history_;
  AutoscaleResult result_;
};

std::function<int(int)> Once(int units) {
  return [units](int t) { return t == 0 ? units : 0; };
}

}  // namespace

AutoscaleResult Simulate(const AutoscaleCase& scenario) { return Simulation(scenario).Run(); }

std::vector<AutoscaleCase> AutoscaleCases() {
  std::vector<AutoscaleCase> cases;
  cases.push_back({.name = "ramp",
                   .title = "A ramp: 0 to 8 units a second within 20 minutes, then nothing",
                   .submitted = [](int t) { return t >= 1200 ? 0 : (t + 1) * (t + 1) / 300 - t * t / 300; }});
  cases.push_back({.name = "burst", .title = "A burst: 4000 units at once", .submitted = Once(4000)});
  cases.push_back({.name = "refused",
                   .title = "The engine refuses for the first 15 minutes",
                   .submitted = Once(2000),
                   .refuses = [](int t) { return t < 900; }});
  cases.push_back({.name = "deaths",
                   .title = "Workers die at their start for the first 30 minutes",
                   .length = absl::Hours(2),
                   .submitted = Once(2000),
                   .deadly = [](int t) { return t < 1800; }});
  cases.push_back({.name = "spot",
                   .title = "Spot machines: half of the workers are taken away after 5 and after 10 minutes",
                   .submitted = Once(4000),
                   .taken = [](int t) { return t == 300 || t == 600 ? 5 : 0; }});
  cases.push_back({.name = "requeue",
                   .title = "Preemption: 10 workers go back into the engine's queue after 5 minutes",
                   .submitted = Once(4000),
                   .taken = [](int t) { return t == 300 ? 10 : 0; },
                   .requeues = true});
  cases.push_back({.name = "budget",
                   .title = "A budget of 2 core-hours for work of 8",
                   .limits = {.maximum = 20, .budget_core_hours = 2},
                   .submitted = Once(19200)});
  return cases;
}

AutoscaleCase AutoscaleCaseNamed(const std::string& name) {
  for (AutoscaleCase& scenario : AutoscaleCases()) {
    if (scenario.name == name) return scenario;
  }
  std::abort();
}

}  // namespace lumifold::sim
