// Random histories checked against a model of the rules: for any events in any order each unit is committed
// exactly once, no unit is lost, a lease that has ended delivers nothing, all units of a job are of one
// numeric class, paused jobs and drained or blocked workers get no leases, units of faulty workers are
// rendered again, those of a kept frame go to one worker and are lost with it, the metrics count every unit
// once, and a restart at any time preserves this.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {
namespace {

using job::Attempt;
using job::FrameUnits;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

constexpr int kWorkers = 4;
constexpr int kSlots = 3;
const char* const kClasses[] = {"avx2", "sse2"};

constexpr absl::Duration kLease = absl::Seconds(20);
constexpr absl::Duration kStall = absl::Seconds(50);

struct ModelLease {
  UnitRef unit;
  Attempt attempt;
  absl::Time deadline;
  absl::Time progressed;
  int64_t progress = 0;
  bool alone = false;  // in quarantine
  bool audit = false;
};

class RandomHistory {
 public:
  /// In every second history units come into quarantine, in every third there are workers that deliver wrong
  /// pixels, and in the second half of every four workers keep frames.
  explicit RandomHistory(uint32_t seed)
      : random_(seed),
        max_lost_workers_(seed % 2 == 0 ? 2 : 1'000'000),
        has_liars_(seed % 3 == 0),
        has_keepers_(seed % 4 >= 2) {
    for (int i = 0; i < 2; ++i) {
      v1::JobSpec& spec = specs_[JobId("j-" + std::to_string(i))];
      spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
      spec.set_width(20);
      spec.set_height(9);
      spec.set_tile_size(8);
      spec.set_samples_per_pixel(10);
      spec.set_pass_samples(4);
      spec.set_frame_count(i == 0 && has_keepers_ ? 3 * kWorkers : 1 + i);
    }
    Restart();
  }

  void Run() {
    for (int step = 0; step < 100'000 && !IsDone(); ++step) Step();
    ASSERT_TRUE(IsDone()) << "units were lost";
    for (const auto& [job, spec] : specs_) {
      const FrameUnits units(spec);
      EXPECT_EQ(scheduler_->jobs().Progress(job).state, v1::JOB_STATE_DONE);
      EXPECT_EQ(scheduler_->jobs().Progress(job).units_done, units.count() * spec.frame_count());
      for (int32_t frame = 0; frame < spec.frame_count(); ++frame) {
        for (int64_t number = 0; number < units.count(); ++number) {
          EXPECT_EQ(commits_[(UnitRef{job, units.KeyOf(frame, number)})], 1);
        }
      }
    }
  }

  int second_leases() const { return second_leases_; }
  int quarantines() const { return quarantines_; }
  int audits() const { return audits_; }
  int revoked() const { return revoked_; }
  int kept() const { return kept_count_; }
  int lost() const { return lost_; }

 private:
  int Draw(int below) { return static_cast<int>(random_() % static_cast<uint32_t>(below)); }

  bool IsDone() const {
    size_t frames = 0;
    for (const auto& [job, spec] : specs_) frames += static_cast<size_t>(spec.frame_count());
    return finished_.size() == frames;
  }

  void Step() {
    now_ += absl::Seconds(Draw(4));
    Act();
    FollowAudits();
    for (const auto& [job, frame] : scheduler_->keeping().TakeBroken()) StopKeeping({job, frame});
    for (const RevokedLease& revoked : scheduler_->units().TakeRevoked()) {
      const auto held = held_.find(revoked.worker);
      if (held == held_.end()) continue;
      for (const ModelLease& lease : held->second) EXPECT_NE(lease.attempt, revoked.attempt);
    }
    CheckMetrics();
  }

  void CheckMetrics() {
    std::set<UnitRef> leased;
    for (const auto& [worker, leases] : held_) {
      for (const ModelLease& lease : leases) {
        if (!lease.audit) leased.insert(lease.unit);
      }
    }
    int64_t queued = 0;
    for (const auto& [job, spec] : specs_) {
      if (!paused_.contains(job)) queued += FrameUnits(spec).count() * spec.frame_count();
    }
    for (const auto& [unit, count] : commits_) queued -= paused_.contains(unit.job) ? 0 : 1;
    for (const UnitRef& unit : leased) queued -= paused_.contains(unit.job) ? 0 : 1;
    const Metrics metrics = scheduler_->CountAll();
    EXPECT_EQ(metrics.units_queued, queued);
    EXPECT_EQ(metrics.units_leased, static_cast<int64_t>(leased.size()));
    EXPECT_EQ(metrics.slots, kWorkers * kSlots);
  }

  /// The caller's part when a frame can be kept no longer, or its result does not come: nothing of it is left.
  void StopKeeping(std::pair<JobId, int32_t> frame) {
    if (kept_.erase(frame) == 0) return;
    ++lost_;
    scheduler_->keeping().Stop(frame.first, frame.second);
    const FrameUnits units(specs_.at(frame.first));
    for (int64_t number = 0; number < units.count(); ++number) {
      const UnitRef unit = {frame.first, units.KeyOf(frame.second, number)};
      EXPECT_EQ(scheduler_->units().Revoke(unit), commits_.erase(unit) == 1);
      EndOthers(unit);
    }
  }

  void FailResult() {
    if (!kept_.empty()) StopKeeping(kept_.begin()->first);
  }

  void LetKeep() {
    if (has_keepers_ && !class_of_job_[JobId("j-0")].empty())
      scheduler_->keeping().SetDemand(JobId("j-0"), {.record_bytes = 1, .finish_bytes = 1});
  }

  void Act() {
    switch (Draw(48)) {
      case 0:
        return Restart();
      case 1:
      case 2:
        return Reconnect();
      case 3:
      case 4:
        return Expire();
      case 5:
      case 6:
      case 7:
        return SendHeartbeat();
      case 8:
        return Fail();
      case 9:
      case 10:
        return DeliverEnded();
      case 11:
        return HandBack();
      case 12:
        return PauseOrResume();
      case 13:
        return DrainOrBlock();
      case 14:
        return Readmit();
      case 15:
      case 16:
        return FinishFrames();
      case 17:
        return FailResult();
      default:
        return Draw(2) == 0 ? Grant() : Deliver();
    }
  }

  void Restart() {
    // Attempts continue above all earlier ones; in the coordinator the clock ensures this.
    scheduler_ = std::make_unique<Scheduler>(
        SchedulerOptions{.lease = kLease,
                         .stall = kStall,
                         .overdue_factor = 1,
                         .overdue_least = absl::Seconds(8),
                         .disputes = {.max_failures = 1'000'000, .max_lost_workers = max_lost_workers_},
                         .first_attempt = Attempt(last_attempt_ + 1)});
    scheduler_->frames().SetMaxActive(2);
    for (const auto& [job, spec] : specs_) {
      const bool second = job == JobId("j-1");
      scheduler_->jobs().Add(job, spec,
                             {.priority = second ? 10 : 0,
                              .user = job.value(),
                              .numeric_class = class_of_job_[job],
                              .paused = paused_.contains(job),
                              .audit_share = second ? 0.5 : 0});
    }
    // What workers keep is not recorded.
    std::erase_if(commits_, [this](const auto& commit) { return KeeperOf(commit.first) != nullptr; });
    kept_.clear();
    LetKeep();
    for (const auto& [job, frame] : finished_) EXPECT_TRUE(scheduler_->frames().RestoreFinished(job, frame));
    for (const auto& [unit, count] : commits_)
      EXPECT_TRUE(scheduler_->units().Restore(unit.job, {unit.key}, now_));
    for (auto& [worker, leases] : held_) EndAll(worker, &leases);
    held_.clear();
    idle_.clear();
    for (int i = 0; i < kWorkers; ++i) Connect();
  }

  void Connect() {
    const WorkerId worker(next_worker_++);
    class_of_worker_[worker] = kClasses[Draw(2)];
    scheduler_->workers().Add(worker, {.numeric_class = class_of_worker_[worker],
                                       .slots = kSlots,
                                       .keep = {.frames = 2, .record_bytes = 9, .finish_bytes = 1}});
    held_[worker];
  }

  void Reconnect() {
    auto victim = std::next(held_.begin(), Draw(kWorkers));
    EndAll(victim->first, &victim->second);
    scheduler_->workers().Remove(victim->first);
    held_.erase(victim);
    Connect();
  }

  void EndAll(WorkerId worker, std::vector<ModelLease>* leases) {
    for (const ModelLease& lease : *leases) ended_.emplace_back(worker, lease);
    leases->clear();
  }

  /// Others that are overdue stay valid.
  void EndOverdueAudit(const LateLease& late) {
    const auto held = held_.find(late.worker);
    if (late.lateness != Lateness::kOverdue || held == held_.end()) return;
    std::erase_if(held->second, [&](const ModelLease& lease) {
      const bool ends = lease.audit && lease.unit == late.unit;
      if (ends) ended_.emplace_back(late.worker, lease);
      return ends;
    });
  }

  void Expire() {
    absl::Time next = absl::InfiniteFuture();
    for (const auto& [worker, leases] : held_) {
      for (const ModelLease& lease : leases) next = std::min(next, lease.deadline);
    }
    EXPECT_LE(scheduler_->NextExpiry(), next);  // or a unit may be overdue before
    for (const LateLease& late : scheduler_->ExpireLeases(now_)) EndOverdueAudit(late);
    FollowAudits();
    for (auto& [worker, leases] : held_) {
      for (auto it = leases.begin(); it != leases.end();) {
        if (it->deadline > now_) {
          ++it;
          continue;
        }
        ended_.emplace_back(worker, *it);
        it = leases.erase(it);
      }
    }
  }

  void SendHeartbeat() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (!leases.empty() && Draw(4) == 0) {
      ended_.emplace_back(worker, leases.back());
      leases.pop_back();  // not in the heartbeat, so it ends
    }
    std::vector<HeldLease> named;
    for (ModelLease& lease : leases) {
      if (Draw(4) != 0) {
        ++lease.progress;
        lease.progressed = now_;
      }
      named.push_back({lease.unit, lease.attempt, lease.progress});
      lease.deadline = std::min(now_ + kLease, lease.progressed + kStall);
    }
    scheduler_->workers().Heartbeat(worker, named, Attempt(last_attempt_), now_);
  }

  void Grant() {
    const WorkerId one = std::next(held_.begin(), Draw(kWorkers))->first;
    const auto granted = Draw(2) == 0 ? scheduler_->GrantLeases(now_) : scheduler_->GrantLeases(one, now_);
    for (const GrantedLease& lease : granted) {
      EXPECT_GT(lease.attempt.value(), last_attempt_);
      last_attempt_ = lease.attempt.value();
      EXPECT_EQ(commits_.contains(lease.unit), lease.audit) << Describe(lease.unit) << " leased again";
      EXPECT_FALSE(paused_.contains(lease.unit.job));
      EXPECT_FALSE(idle_.contains(lease.worker)) << "drained or blocked";
      CheckKept(lease);
      int others = 0;
      for (const auto& [other, theirs] : held_) {
        for (const ModelLease& held : theirs) {
          if (held.unit != lease.unit) continue;
          EXPECT_NE(other, lease.worker) << "two leases of one unit for one worker";
          ++others;
        }
      }
      EXPECT_LE(others, lease.audit ? 0 : 1) << "three leases of one unit";
      second_leases_ += others;
      audits_ += lease.audit ? 1 : 0;
      if (lease.alone) {
        ++quarantines_;
        EXPECT_TRUE(held_.at(lease.worker).empty()) << "a unit in quarantine has the worker for itself";
      }
      for (const ModelLease& held : held_.at(lease.worker)) EXPECT_FALSE(held.alone);
      held_.at(lease.worker)
          .push_back({lease.unit, lease.attempt, now_ + kLease, now_, 0, lease.alone, lease.audit});
    }
    for (const auto& [worker, leases] : held_) EXPECT_LE(leases.size(), static_cast<size_t>(kSlots));
  }

  /// The worker that keeps the unit's frame; null if nobody does.
  const WorkerId* KeeperOf(const UnitRef& unit) const {
    const auto kept = kept_.find({unit.job, unit.key.frame});
    return kept == kept_.end() ? nullptr : &kept->second;
  }

  void CheckKept(const GrantedLease& lease) {
    const WorkerId* const keeper = KeeperOf(lease.unit);
    if (keeper != nullptr) {
      EXPECT_TRUE(lease.keep);
      EXPECT_EQ(lease.worker, *keeper);
    } else if (lease.keep) {
      EXPECT_TRUE(std::none_of(commits_.begin(), commits_.end(), [&](const auto& commit) {
        return commit.first.job == lease.unit.job && commit.first.key.frame == lease.unit.key.frame;
      })) << "a frame that others have begun";
      kept_.emplace(std::pair(lease.unit.job, lease.unit.key.frame), lease.worker);
      ++kept_count_;
    }
  }

  void Deliver() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (leases.empty()) return;
    const ModelLease lease = leases[static_cast<size_t>(Draw(static_cast<int>(leases.size())))];
    std::erase_if(leases, [&](const ModelLease& held) { return held.attempt == lease.attempt; });
    const bool lies = has_liars_ && worker.value() % 5 == 0;
    const std::string digest = lies ? "wrong " + std::to_string(lease.attempt.value()) : Describe(lease.unit);
    ASSERT_EQ(scheduler_->units().Complete(worker, lease.unit, lease.attempt, now_, digest),
              lease.audit ? Completion::kAudited : Completion::kAccepted);
    ended_.emplace_back(worker, lease);  // a second delivery is a duplicate
    if (lease.audit) return;
    EndOthers(lease.unit);
    BindTo(lease.unit.job, class_of_worker_.at(worker));
    scheduler_->units().Commit(lease.unit);
    ++commits_[lease.unit];
    LetKeep();
  }

  void EndOthers(const UnitRef& unit) {
    for (auto& [worker, leases] : held_) {
      for (const ModelLease& lease : leases) {
        if (lease.unit == unit) ended_.emplace_back(worker, lease);
      }
      std::erase_if(leases, [&](const ModelLease& lease) { return lease.unit == unit; });
    }
  }

  void BindTo(const JobId& job, const std::string& numeric_class) {
    std::string& bound = class_of_job_[job];
    EXPECT_TRUE(bound.empty() || bound == numeric_class);
    bound = numeric_class;
    EXPECT_EQ(scheduler_->jobs().NumericClassOf(job), bound);
    for (auto& [worker, leases] : held_) {
      if (class_of_worker_.at(worker) == bound) continue;
      for (const ModelLease& lease : leases) {
        if (lease.unit.job == job) ended_.emplace_back(worker, lease);
      }
      std::erase_if(leases, [&](const ModelLease& lease) { return lease.unit.job == job; });
    }
  }

  void DeliverEnded() {
    if (ended_.empty()) return;
    const auto& [worker, lease] = ended_[static_cast<size_t>(Draw(static_cast<int>(ended_.size())))];
    const Completion completion = scheduler_->units().Complete(worker, lease.unit, lease.attempt, now_);
    EXPECT_EQ(completion, commits_.contains(lease.unit) ? Completion::kDuplicate : Completion::kStale);
  }

  /// The caller's part when a worker is found faulty: its units are lost and rendered again.
  void FollowAudits() {
    for (const FaultyWorker& faulty : scheduler_->workers().TakeFaulty()) {
      EXPECT_TRUE(has_liars_);
      for (const WorkerId worker : scheduler_->workers().Named(faulty.name)) {
        EXPECT_EQ(worker.value() % 5, 0) << "an honest worker was blocked";
        EndAll(worker, &held_.at(worker));
        idle_.insert(worker);
      }
      for (const UnitRef& unit : faulty.units) {
        if (!commits_.contains(unit)) continue;  // of a kept frame, which is lost as a whole
        if (KeeperOf(unit) != nullptr) {
          StopKeeping({unit.job, unit.key.frame});
          continue;
        }
        EXPECT_TRUE(scheduler_->units().Revoke(unit));
        EXPECT_EQ(commits_.erase(unit), 1u);
        EXPECT_FALSE(finished_.contains({unit.job, unit.key.frame}));
        EndOthers(unit);  // audits of it
        ++revoked_;
      }
    }
  }

  void FinishFrames() {
    for (const auto& [job, spec] : specs_) {
      for (const int32_t frame : scheduler_->frames().Committed(job)) {
        EXPECT_TRUE(scheduler_->frames().IsCommitted(job, frame));
        finished_.emplace(job, frame);
        kept_.erase({job, frame});
        scheduler_->keeping().End(job, frame);
        scheduler_->frames().Finish(job, frame);
      }
    }
  }

  void HandBack() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (leases.empty()) return;
    const ModelLease lease = leases.back();
    leases.pop_back();
    EXPECT_TRUE(scheduler_->units().HandBack(worker, lease.unit, lease.attempt));
    ended_.emplace_back(worker, lease);
  }

  void PauseOrResume() {
    const JobId job = std::next(specs_.begin(), Draw(2))->first;
    if (paused_.erase(job) > 0) return scheduler_->jobs().Resume(job);
    if (Draw(4) > 0) return;
    paused_.insert(job);
    scheduler_->jobs().Pause(job);
  }

  void DrainOrBlock() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    idle_.insert(worker);
    if (Draw(2) == 0) return scheduler_->workers().Drain(worker);
    scheduler_->workers().Block("w-" + std::to_string(worker.value()), "a test");
    EndAll(worker, &leases);
  }

  void Readmit() {
    for (const WorkerId worker : idle_) scheduler_->workers().Readmit("w-" + std::to_string(worker.value()));
    idle_.clear();
  }

  void Fail() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (leases.empty()) return;
    const ModelLease lease = leases.back();
    leases.pop_back();
    EXPECT_TRUE(scheduler_->units().Fail(worker, lease.unit, lease.attempt, {}, now_));
    ended_.emplace_back(worker, lease);
  }

  std::mt19937 random_;
  absl::Time now_ = absl::FromUnixSeconds(1'000'000);
  std::map<JobId, v1::JobSpec> specs_;
  std::unique_ptr<Scheduler> scheduler_;
  int64_t next_worker_ = 1;
  int64_t last_attempt_ = 0;
  std::map<WorkerId, std::vector<ModelLease>> held_;
  std::vector<std::pair<WorkerId, ModelLease>> ended_;
  int max_lost_workers_;
  bool has_liars_;
  bool has_keepers_;
  std::map<std::pair<JobId, int32_t>, WorkerId> kept_;  // frames
  int kept_count_ = 0;
  int lost_ = 0;
  int second_leases_ = 0;  // of late units
  int audits_ = 0;
  int revoked_ = 0;
  std::set<JobId> paused_;
  std::set<WorkerId> idle_;  // drained or blocked
  std::set<std::pair<JobId, int32_t>> finished_;
  int quarantines_ = 0;
  std::map<WorkerId, std::string> class_of_worker_;
  std::map<JobId, std::string> class_of_job_;  // empty before the first commit
  std::map<UnitRef, int> commits_;             // the contents of the ledger
};

class SchedulerRandom : public ::testing::TestWithParam<uint32_t> {};

TEST_P(SchedulerRandom, CommitsEachUnitExactlyOnceWhateverHappens) { RandomHistory(GetParam()).Run(); }

TEST(SchedulerRandomHistory, TheHistoriesHaveAllThatCanHappen) {
  int second_leases = 0;
  int quarantines = 0;
  int audits = 0;
  int revoked = 0;
  int kept = 0;
  int lost = 0;
  for (uint32_t seed = 0; seed < 30; ++seed) {
    RandomHistory history(seed);
    history.Run();
    second_leases += history.second_leases();
    quarantines += history.quarantines();
    audits += history.audits();
    revoked += history.revoked();
    kept += history.kept();
    lost += history.lost();
  }
  EXPECT_GT(second_leases, 0);
  EXPECT_GT(quarantines, 0);
  EXPECT_GT(audits, 0);
  EXPECT_GT(revoked, 0);
  EXPECT_GT(lost, 0);
  EXPECT_GT(kept, lost);
}

INSTANTIATE_TEST_SUITE_P(Seeds, SchedulerRandom, ::testing::Range(0u, 30u));

}  // namespace
}  // namespace lumifold::scheduler
