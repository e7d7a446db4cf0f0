#include "tests/bench/farm_sim.h"

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <queue>
#include <random>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/scheduler/scheduler.h"
#include "tests/bench/share_window.h"
#include "tests/bench/unit_costs.h"

namespace lumifold::sim {
namespace {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;
using scheduler::Completion;
using scheduler::GrantedLease;
using scheduler::Scheduler;

const absl::Time kStart = absl::FromUnixSeconds(1'000'000);

/// Ends a simulation that makes no progress.
constexpr absl::Duration kLimit = absl::Hours(100);

constexpr double kStraggler = 10;

/// After which a process that has ended is followed by the next one, which its machine starts.
constexpr absl::Duration kRestart = absl::Seconds(5);

struct SimJob {
  JobId id;
  int user = 0;
  double weight = 1;
  int priority = 0;
  int64_t total = 0;
  int64_t leased = 0;  // for the first time
  bool submitted = false;
  bool ended = false;
  bool is_bad = false;
  absl::Time submitted_at;

  bool HasFreeUnits() const { return submitted && !ended && leased < total; }
};

struct SimWorker {
  std::string name;
  double speed = 1;
  bool is_bad = false;
  int64_t generation = 0;  // of its present connection
  std::deque<int> scenes;  // jobs, the last used first
  std::map<int64_t, GrantedLease> leases;
  std::set<int64_t> hung;  // attempts
};

enum class Event {
  kSubmit,
  kAnswer,
  kFinish,
  kFail,
  kDeliver,
  kCommit,
  kFrame,
  kHeartbeat,
  kDie,
  kCrash,
  kReboot,
  kTick,
};

struct Item {
  absl::Time time;
  int64_t sequence = 0;
  Event event = Event::kTick;
  int64_t subject = 0;  // job for kSubmit and kFrame, worker otherwise
  int64_t detail = 0;   // attempt, or frame
  bool operator>(const Item& other) const {
    return std::pair(time, sequence) > std::pair(other.time, other.sequence);
  }
};

class Farm {
 public:
  explicit Farm(const FarmSettings& settings)
      : settings_(settings),
        random_(settings.seed),
        scheduler_(scheduler::SchedulerOptions{}),
        costs_(settings),
        shares_(settings.users, absl::ToDoubleSeconds(settings.window)) {
    bytes_before_ = static_cast<int64_t>(mallinfo2().uordblks);
    scheduler_.frames().SetMaxActive(settings.max_active_frames);
    MakeJobs();
    MakeWorkers();
    Push(absl::Seconds(1), Event::kTick, 0, 0);
    window_end_ = kStart + settings_.window;
  }

  FarmResult Run() {
    while (!queue_.empty() && ended_jobs_ < settings_.jobs && now_ < kStart + kLimit) {
      const Item item = queue_.top();
      queue_.pop();
      while (item.time >= window_end_) CloseWindow();
      now_ = item.time;
      Handle(item);
    }
    result_.finished = ended_jobs_ == settings_.jobs;
    result_.makespan = now_ - kStart;
    double speed = 0;
    for (const SimWorker& worker : workers_) speed += worker.speed * settings_.slots;
    result_.ideal = absl::Seconds(costs_.total_seconds() / speed);
    result_.longest_unit = costs_.longest_unit() / settings_.slowest;
    return result_;
  }

 private:
  double Uniform() { return static_cast<double>(random_()) / 4294967296.0; }
  double LogUniform(double spread) { return std::pow(spread, 2 * Uniform() - 1); }
  double Exponential() { return -std::log(1 - Uniform()); }

  void Push(absl::Duration delay, Event event, int64_t subject, int64_t detail) {
    queue_.push({now_ + delay, sequence_++, event, subject, detail});
  }

  template <typename Call>
  auto Timed(Call call) {
    ++result_.calls;
    const auto begin = std::chrono::steady_clock::now();
    struct Stop {
      decltype(begin) from;
      double* seconds;
      ~Stop() { *seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count(); }
    } stop{begin, &result_.scheduler_seconds};
    return call();
  }

  void MakeJobs() {
    for (int i = 0; i < settings_.jobs; ++i) {
      SimJob job;
      job.id = JobId(absl::StrCat("j-", i));
      job.user = i % settings_.users;
      job.priority = i % 5 == 0 ? settings_.high_priority : 0;
      job.is_bad = i < settings_.bad_jobs;
      job.weight = std::exp2(job.priority / 10.0);
      costs_.AddJob(absl::ToDoubleSeconds(settings_.mean_unit) * settings_.unit_scale *
                    LogUniform(settings_.job_spread));
      job.total = costs_.units_of_a_job();
      numbers_[job.id] = i;
      result_.units += job.total;
      const double turn = static_cast<double>(i / settings_.users) * settings_.users / settings_.jobs;
      jobs_.push_back(std::move(job));
      Push(settings_.arrivals * turn, Event::kSubmit, i, 0);
    }
  }

  void MakeWorkers() {
    for (int i = 0; i < settings_.workers; ++i) {
      SimWorker worker;
      worker.name = absl::StrCat("host-", i);
      worker.speed = LogUniform(1 / settings_.slowest);
      worker.is_bad = i < settings_.bad_machines;
      workers_.push_back(std::move(worker));
      if (i < settings_.bad_machines || settings_.alone == absl::ZeroDuration()) {
        Connect(i);
      } else {
        Push(settings_.alone, Event::kReboot, i, 0);
      }
    }
  }

  void Connect(int64_t index) {
    SimWorker& worker = workers_[static_cast<size_t>(index)];
    worker.generation = next_worker_++;
    worker_of_[worker.generation] = index;
    Timed([&] {
      scheduler_.workers().Add(WorkerId(worker.generation),
                               {.name = worker.name,
                                .numeric_class = "avx2",
                                .instance = static_cast<uint64_t>(worker.generation),
                                .slots = settings_.slots});
    });
    Push(settings_.heartbeat * Uniform(), Event::kHeartbeat, worker.generation, 0);
    Push(settings_.mean_life * Exponential(), Event::kDie, worker.generation, 0);
  }

  SimWorker* Connected(int64_t generation) {
    const auto found = worker_of_.find(generation);
    return found == worker_of_.end() ? nullptr : &workers_[static_cast<size_t>(found->second)];
  }

  void Handle(const Item& item) {
    switch (item.event) {
      case Event::kSubmit:
        return Submit(static_cast<int>(item.subject));
      case Event::kFinish:
        return Finish(item.subject, item.detail);
      case Event::kAnswer:
        return Answer(item.subject, item.detail);
      case Event::kFail:
        return Fail(item.subject, item.detail);
      case Event::kDeliver:
        return Deliver(item.subject, item.detail);
      case Event::kCommit:
        return Commit(item.detail);
      case Event::kFrame:
        return FinishFrame(static_cast<int>(item.subject), static_cast<int32_t>(item.detail));
      case Event::kHeartbeat:
        return Heartbeat(item.subject);
      case Event::kDie:
        return Die(item.subject, settings_.reboot);
      case Event::kCrash:
        return Crash(item.subject, item.detail);
      case Event::kReboot:
        Connect(item.subject);
        return Grant();
      case Event::kTick:
        return Tick();
    }
  }

  void Submit(int index) {
    SimJob& job = jobs_[static_cast<size_t>(index)];
    job.submitted = true;
    job.submitted_at = now_;
    Timed([&] {
      scheduler_.jobs().Add(job.id, costs_.spec(),
                            {.priority = job.priority,
                             .user = absl::StrCat("user-", job.user),
                             .audit_share = settings_.audit_share});
    });
    Grant();
  }

  void Grant() {
    EndFailedJobs();
    for (const GrantedLease& lease : Timed([&] { return scheduler_.GrantLeases(now_); })) Start(lease);
    for (const auto& revoked : scheduler_.units().TakeRevoked()) {
      SimWorker* worker = Connected(revoked.worker.value());
      if (worker != nullptr) Stop(*worker, revoked.attempt.value());
    }
  }

  void Start(const GrantedLease& lease) {
    ++result_.leases;
    const int index = numbers_.at(lease.unit.job);
    SimJob& job = jobs_[static_cast<size_t>(index)];
    if (!lease.audit && !first_leased_.insert(lease.unit).second) {
      ++result_.second_leases;
    } else if (!lease.audit) {
      ++job.leased;
      result_.last_leased = now_ - kStart;
    }
    CountWait(job);
    served_[{job.user, job.priority}] = now_;
    SimWorker& worker = *Connected(lease.worker.value());
    worker.leases.emplace(lease.attempt.value(), lease);
    began_[lease.attempt.value()] = now_;
    Push(settings_.network, Event::kAnswer, lease.worker.value(), lease.attempt.value());
    if (Uniform() < settings_.hang_share || Does(worker, Misdeed::kHangs)) {
      if (worker.is_bad) ++result_.spoiled_by_machines;
      worker.hung.insert(lease.attempt.value());
      return;
    }
    double seconds = costs_.SecondsOf(index, lease.unit.key) / worker.speed;
    if (Uniform() < settings_.straggler_share) seconds *= kStraggler;
    absl::Duration time = absl::Seconds(seconds) + settings_.network * Uniform();
    if (Load(worker, index)) time += settings_.scene_load;
    const Event end = EndOf(worker, job, &time);
    Push(time, end, lease.worker.value(), lease.attempt.value());
  }

  bool Does(const SimWorker& worker, Misdeed misdeed) const {
    return worker.is_bad && settings_.misdeed == misdeed;
  }

  /// What becomes of a lease that takes `time` to render; it may end earlier.
  Event EndOf(const SimWorker& worker, const SimJob& job, absl::Duration* time) {
    const bool calls_impossible =
        Does(worker, Misdeed::kFailsAll) || (Does(worker, Misdeed::kFailsOneScene) && &job == &jobs_[0]);
    const bool fails = calls_impossible || Does(worker, Misdeed::kFailsSlowly);
    if (fails || Does(worker, Misdeed::kDies)) {
      ++result_.spoiled_by_machines;
      if (calls_impossible) *time = 2 * settings_.network;
      if (!fails) *time *= Uniform();
      return fails ? Event::kFail : Event::kCrash;
    }
    if (!job.is_bad) return Event::kFinish;
    ++result_.spoiled_by_jobs;
    *time *= Uniform();
    return settings_.badness == BadJob::kFails ? Event::kFail : Event::kCrash;
  }

  /// Whether the worker has to load the job's scene.
  bool Load(SimWorker& worker, int job) {
    const auto found = std::find(worker.scenes.begin(), worker.scenes.end(), job);
    const bool is_new = found == worker.scenes.end();
    if (!is_new) worker.scenes.erase(found);
    worker.scenes.push_front(job);
    if (static_cast<int>(worker.scenes.size()) > settings_.scenes_kept) worker.scenes.pop_back();
    result_.scene_loads += is_new ? 1 : 0;
    return is_new;
  }

  /// The worker stops rendering the unit; its job pays for the time.
  void Stop(SimWorker& worker, int64_t attempt) {
    const auto lease = worker.leases.find(attempt);
    if (lease == worker.leases.end()) return;
    Pay(lease->second.unit.job, attempt);
    worker.leases.erase(lease);
    worker.hung.erase(attempt);
  }

  void Pay(const JobId& job, int64_t attempt) {
    const auto began = began_.find(attempt);
    const SimJob& paying = jobs_[static_cast<size_t>(numbers_.at(job))];
    const absl::Time from = std::max(began->second, window_end_ - settings_.window);
    shares_.Use(paying.user, absl::ToDoubleSeconds(now_ - from));
    began_.erase(began);
  }

  /// The worker has received the lease, and says so.
  void Answer(int64_t generation, int64_t attempt) {
    const SimWorker* worker = Connected(generation);
    if (worker == nullptr || !worker->leases.contains(attempt)) return;
    const scheduler::HeldLease held{worker->leases.at(attempt).unit, Attempt(attempt), 0};
    Timed([&] { scheduler_.workers().Heartbeat(WorkerId(generation), {held}, Attempt(0), now_); });
  }

  void Fail(int64_t generation, int64_t attempt) {
    SimWorker* worker = Connected(generation);
    if (worker == nullptr || !worker->leases.contains(attempt)) return;
    const GrantedLease lease = worker->leases.at(attempt);
    Stop(*worker, attempt);
    Timed([&] {
      const scheduler::UnitFailure failure{.permanent = !Does(*worker, Misdeed::kFailsSlowly),
                                           .error = "made up"};
      return scheduler_.units().Fail(WorkerId(generation), lease.unit, lease.attempt, failure, now_);
    });
    Grant();
  }

  void EndFailedJobs() {
    for (const scheduler::FailedJob& failed : scheduler_.TakeFailedJobs()) {
      SimJob& job = jobs_[static_cast<size_t>(numbers_.at(failed.job))];
      if (job.ended) continue;
      scheduler_.jobs().End(job.id);
      job.ended = true;
      ++ended_jobs_;
      ++(job.is_bad ? result_.bad_failed : result_.innocent_failed);
    }
  }

  void Finish(int64_t generation, int64_t attempt) {
    const SimWorker* worker = Connected(generation);
    if (worker == nullptr || !worker->leases.contains(attempt)) return;
    Push(settings_.network * Uniform(), Event::kDeliver, generation, attempt);
  }

  void Deliver(int64_t generation, int64_t attempt) {
    SimWorker* worker = Connected(generation);
    if (worker == nullptr || !worker->leases.contains(attempt)) return;
    const GrantedLease lease = worker->leases.at(attempt);
    Stop(*worker, attempt);
    const bool wrong = Does(*worker, Misdeed::kLies) && Uniform() < 0.5;
    if (wrong) ++result_.spoiled_by_machines;
    const std::string digest = wrong ? absl::StrCat("wrong ", attempt) : "right";
    const Completion completion = Timed([&] {
      return scheduler_.units().Complete(WorkerId(generation), lease.unit, lease.attempt, now_, digest);
    });
    if (completion == Completion::kAccepted) {
      if (wrong) {
        wrong_.insert(lease.unit);
      } else {
        wrong_.erase(lease.unit);
      }
      committing_.emplace(attempt, lease.unit);
      Push(settings_.commit * Uniform(), Event::kCommit, generation, attempt);
    }
    FollowAudits();
    Grant();
  }

  void Commit(int64_t attempt) {
    const auto committing = committing_.find(attempt);
    const UnitRef unit = committing->second;
    committing_.erase(committing);
    if (Timed([&] { return scheduler_.units().Commit(unit); }))
      Push(settings_.filter, Event::kFrame, numbers_.at(unit.job), unit.key.frame);
    FollowAudits();
    Grant();
  }

  void FollowAudits() {
    for (const auto& faulty : scheduler_.workers().TakeFaulty()) {
      faulty_.insert(faulty.name);
      result_.faulty_found = static_cast<int>(faulty_.size());
      for (const UnitRef& unit : faulty.units)
        result_.units_redone += scheduler_.units().Revoke(unit) ? 1 : 0;
    }
    for (const auto& [job, frame] : scheduler_.frames().TakeSettled())
      Push(settings_.filter, Event::kFrame, numbers_.at(job), frame);
  }

  void FinishFrame(int index, int32_t frame) {
    SimJob& job = jobs_[static_cast<size_t>(index)];
    if (!scheduler_.frames().IsCommitted(job.id, frame)) return;
    for (auto it = wrong_.begin(); it != wrong_.end();) {
      const bool here = it->job == job.id && it->key.frame == frame;
      result_.wrong_units += here ? 1 : 0;
      it = here ? wrong_.erase(it) : std::next(it);
    }
    if (Timed([&] { return scheduler_.frames().Finish(job.id, frame); })) {
      scheduler_.jobs().End(job.id);
      job.ended = true;
      ++ended_jobs_;
    }
    Grant();
  }

  void Heartbeat(int64_t generation) {
    SimWorker* worker = Connected(generation);
    if (worker == nullptr) return;
    ++result_.heartbeats;
    std::vector<scheduler::HeldLease> held;
    const int64_t progress = absl::ToUnixMillis(now_);
    for (const auto& [attempt, lease] : worker->leases)
      held.push_back({lease.unit, lease.attempt, worker->hung.contains(attempt) ? 0 : progress});
    const Attempt newest(worker->leases.empty() ? 0 : worker->leases.rbegin()->first);
    Timed([&] { scheduler_.workers().Heartbeat(WorkerId(generation), held, newest, now_); });
    Push(settings_.heartbeat, Event::kHeartbeat, generation, 0);
  }

  void Crash(int64_t generation, int64_t attempt) {
    const SimWorker* worker = Connected(generation);
    if (worker == nullptr || !worker->leases.contains(attempt)) return;
    const SimJob& job = jobs_[static_cast<size_t>(numbers_.at(worker->leases.at(attempt).unit.job))];
    if (job.ended) return;
    if (job.is_bad) ++result_.workers_ended;
    Die(generation, kRestart);
  }

  void Die(int64_t generation, absl::Duration pause) {
    SimWorker* worker = Connected(generation);
    if (worker == nullptr) return;
    ++result_.deaths;
    Timed([&] { return scheduler_.workers().Remove(WorkerId(generation)); });
    while (!worker->leases.empty()) Stop(*worker, worker->leases.begin()->first);
    worker->scenes.clear();
    const int64_t index = worker_of_.at(generation);
    worker_of_.erase(generation);
    Push(pause, Event::kReboot, index, 0);
    Grant();
  }

  /// The coordinator's housekeeping, each second here.
  void Tick() {
    Timed([&] { return scheduler_.ExpireLeases(now_); });
    FollowAudits();
    Grant();
    for (const SimJob& job : jobs_) {
      if (job.HasFreeUnits()) CountWait(job);
    }
    if (now_ == kStart + absl::Minutes(1)) {
      result_.reasons = absl::StrJoin(scheduler_.Explain(jobs_[0].id, now_), " ",
                                      [](std::string* text, const auto& reason) { *text += reason.code; });
    }
    if (++ticks_ % 64 == 0) {
      const int64_t own = static_cast<int64_t>(first_leased_.size() * kFirstLeasedBytes);
      result_.scheduler_bytes =
          std::max(result_.scheduler_bytes, static_cast<int64_t>(mallinfo2().uordblks) - bytes_before_ - own);
    }
    Push(absl::Seconds(1), Event::kTick, 0, 0);
  }

  void CountWait(const SimJob& job) {
    // Jobs of one user and priority take turns.
    const absl::Duration wait = now_ - std::max(job.submitted_at, served_[{job.user, job.priority}]);
    if (wait <= result_.longest_wait) return;
    result_.longest_wait = wait;
    result_.waited_at = now_ - kStart;
  }

  /// Compares the shares of the users that had free units at both ends of the window.
  void CloseWindow() {
    for (const auto& [generation, index] : worker_of_) {
      for (const auto& [attempt, lease] : workers_[static_cast<size_t>(index)].leases) {
        const absl::Time from = std::max(began_.at(attempt), window_end_ - settings_.window);
        shares_.Use(jobs_[static_cast<size_t>(numbers_.at(lease.unit.job))].user,
                    absl::ToDoubleSeconds(window_end_ - from));
      }
    }
    const double unfairness = shares_.Close(Weights());
    if (unfairness > result_.unfairness) {
      result_.unfairness = unfairness;
      result_.unfair_at = window_end_ - kStart;
    }
    window_end_ += settings_.window;
  }

  /// By user: the weight of its highest job with free units; 0 without such a job. Where the highest job has
  /// none, the weight counts all active jobs, so that the window is left out.
  std::vector<double> Weights() {
    std::vector<double> weights(static_cast<size_t>(settings_.users));
    std::vector<bool> has_free(weights.size());
    for (const SimJob& job : jobs_) {
      const auto user = static_cast<size_t>(job.user);
      if (job.HasFreeUnits()) has_free[user] = true;
      if (job.submitted && !job.ended) weights[user] = std::max(weights[user], job.weight);
    }
    for (size_t user = 0; user < weights.size(); ++user) {
      if (!has_free[user]) weights[user] = 0;
    }
    return weights;
  }

  /// What malloc counts for an entry of first_leased_, which is ours and not the scheduler's.
  static constexpr size_t kFirstLeasedBytes = 96;

  const FarmSettings settings_;
  std::mt19937 random_;
  int64_t bytes_before_ = 0;
  Scheduler scheduler_;
  FarmResult result_;
  absl::Time now_ = kStart;
  int64_t sequence_ = 0;
  int64_t ticks_ = 0;
  std::priority_queue<Item, std::vector<Item>, std::greater<>> queue_;
  UnitCosts costs_;
  std::vector<SimJob> jobs_;
  std::map<JobId, int> numbers_;
  int ended_jobs_ = 0;
  std::vector<SimWorker> workers_;
  int64_t next_worker_ = 1;
  std::map<int64_t, int64_t> worker_of_;  // index of the worker, by connection
  std::set<UnitRef> first_leased_;
  std::map<int64_t, absl::Time> began_;               // by attempt
  std::map<std::pair<int, int>, absl::Time> served_;  // by user and priority, the last lease
  std::map<int64_t, UnitRef> committing_;
  std::set<UnitRef> wrong_;
  std::set<std::string> faulty_;
  absl::Time window_end_;
  ShareWindow shares_;
};

}  // namespace

FarmResult Simulate(const FarmSettings& settings) { return Farm(settings).Run(); }

}  // namespace lumifold::sim
