// Random histories checked against a model of the rules: for any events in any order each unit is committed
// exactly once, no unit is lost, a void lease delivers nothing, all units of a job are of one numeric class,
// and a restart at any time preserves this.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
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
};

class RandomHistory {
 public:
  /// In every second history units come into quarantine.
  explicit RandomHistory(uint32_t seed) : random_(seed), max_lost_workers_(seed % 2 == 0 ? 2 : 1'000'000) {
    for (int i = 0; i < 2; ++i) {
      v1::JobSpec& spec = specs_[JobId("j-" + std::to_string(i))];
      spec.set_width(20);
      spec.set_height(9);
      spec.set_tile_size(8);
      spec.set_samples_per_pixel(10);
      spec.set_pass_samples(4);
      spec.set_frame_count(1 + i);
    }
    Restart();
  }

  void Run() {
    for (int step = 0; step < 100'000 && !IsDone(); ++step) Step();
    ASSERT_TRUE(IsDone()) << "units were lost";
    for (const auto& [job, spec] : specs_) {
      const FrameUnits units(spec);
      EXPECT_EQ(scheduler_->Progress(job).units_done, units.count() * spec.frame_count());
      for (int32_t frame = 0; frame < spec.frame_count(); ++frame) {
        for (int64_t number = 0; number < units.count(); ++number) {
          EXPECT_EQ(commits_[(UnitRef{job, units.KeyOf(frame, number)})], 1);
        }
      }
    }
  }

  int second_leases() const { return second_leases_; }
  int quarantines() const { return quarantines_; }

 private:
  int Draw(int below) { return static_cast<int>(random_() % static_cast<uint32_t>(below)); }

  bool IsDone() const {
    size_t total = 0;
    for (const auto& [job, spec] : specs_) {
      total += static_cast<size_t>(FrameUnits(spec).count()) * static_cast<size_t>(spec.frame_count());
    }
    return commits_.size() == total;
  }

  void Step() {
    now_ += absl::Seconds(Draw(4));
    switch (Draw(40)) {
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
        return DeliverVoid();
      default:
        return Draw(2) == 0 ? Grant() : Deliver();
    }
  }

  void Restart() {
    // Attempts continue above all earlier ones; in the coordinator the clock ensures this.
    scheduler_ = std::make_unique<Scheduler>(SchedulerOptions{.lease = kLease,
                                                              .stall = kStall,
                                                              .overdue_factor = 1,
                                                              .overdue_least = absl::Seconds(8),
                                                              .max_failures = 1'000'000,
                                                              .max_lost_workers = max_lost_workers_,
                                                              .first_attempt = Attempt(last_attempt_ + 1)});
    for (const auto& [job, spec] : specs_) scheduler_->AddJob(job, spec, class_of_job_[job]);
    for (const auto& [unit, count] : commits_) EXPECT_TRUE(scheduler_->RestoreCommittedUnit(unit));
    for (auto& [worker, leases] : held_) MakeVoid(worker, &leases);
    held_.clear();
    for (int i = 0; i < kWorkers; ++i) Connect();
  }

  void Connect() {
    const WorkerId worker(next_worker_++);
    class_of_worker_[worker] = kClasses[Draw(2)];
    scheduler_->AddWorker(worker, class_of_worker_[worker], kSlots);
    held_[worker];
  }

  void Reconnect() {
    auto victim = std::next(held_.begin(), Draw(kWorkers));
    MakeVoid(victim->first, &victim->second);
    scheduler_->RemoveWorker(victim->first);
    held_.erase(victim);
    Connect();
  }

  void MakeVoid(WorkerId worker, std::vector<ModelLease>* leases) {
    for (const ModelLease& lease : *leases) void_.emplace_back(worker, lease);
    leases->clear();
  }

  void Expire() {
    absl::Time next = absl::InfiniteFuture();
    for (const auto& [worker, leases] : held_) {
      for (const ModelLease& lease : leases) next = std::min(next, lease.deadline);
    }
    EXPECT_LE(scheduler_->NextExpiry(), next);  // or a unit may be overdue before
    scheduler_->ExpireLeases(now_);
    for (auto& [worker, leases] : held_) {
      for (auto it = leases.begin(); it != leases.end();) {
        if (it->deadline > now_) {
          ++it;
          continue;
        }
        void_.emplace_back(worker, *it);
        it = leases.erase(it);
      }
    }
  }

  void SendHeartbeat() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (!leases.empty() && Draw(4) == 0) {
      void_.emplace_back(worker, leases.back());
      leases.pop_back();  // not in the heartbeat, so void
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
    scheduler_->Heartbeat(worker, named, Attempt(last_attempt_), now_);
  }

  void Grant() {
    const WorkerId one = std::next(held_.begin(), Draw(kWorkers))->first;
    const auto granted = Draw(2) == 0 ? scheduler_->GrantLeases(now_) : scheduler_->GrantLeases(one, now_);
    for (const GrantedLease& lease : granted) {
      EXPECT_GT(lease.attempt.value(), last_attempt_);
      last_attempt_ = lease.attempt.value();
      EXPECT_FALSE(commits_.contains(lease.unit)) << Describe(lease.unit) << " leased again";
      int others = 0;
      for (const auto& [other, theirs] : held_) {
        for (const ModelLease& held : theirs) {
          if (held.unit != lease.unit) continue;
          EXPECT_NE(other, lease.worker) << "two leases of one unit for one worker";
          ++others;
        }
      }
      EXPECT_LE(others, 1) << "three leases of one unit";
      second_leases_ += others;
      if (lease.alone) {
        ++quarantines_;
        EXPECT_TRUE(held_.at(lease.worker).empty()) << "a unit in quarantine has the worker for itself";
      }
      for (const ModelLease& held : held_.at(lease.worker)) EXPECT_FALSE(held.alone);
      held_.at(lease.worker).push_back({lease.unit, lease.attempt, now_ + kLease, now_, 0, lease.alone});
    }
    for (const auto& [worker, leases] : held_) EXPECT_LE(leases.size(), static_cast<size_t>(kSlots));
  }

  void Deliver() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (leases.empty()) return;
    const ModelLease lease = leases[static_cast<size_t>(Draw(static_cast<int>(leases.size())))];
    std::erase_if(leases, [&](const ModelLease& held) { return held.attempt == lease.attempt; });
    ASSERT_EQ(scheduler_->CompleteUnit(worker, lease.unit, lease.attempt, now_), Completion::kAccepted);
    void_.emplace_back(worker, lease);  // a second delivery is a duplicate
    MakeVoidOthers(lease.unit);
    BindTo(lease.unit.job, class_of_worker_.at(worker));
    scheduler_->UnitCommitted(lease.unit);
    ++commits_[lease.unit];
  }

  void MakeVoidOthers(const UnitRef& unit) {
    for (auto& [worker, leases] : held_) {
      for (const ModelLease& lease : leases) {
        if (lease.unit == unit) void_.emplace_back(worker, lease);
      }
      std::erase_if(leases, [&](const ModelLease& lease) { return lease.unit == unit; });
    }
  }

  void BindTo(const JobId& job, const std::string& numeric_class) {
    std::string& bound = class_of_job_[job];
    EXPECT_TRUE(bound.empty() || bound == numeric_class);
    bound = numeric_class;
    EXPECT_EQ(scheduler_->NumericClassOf(job), bound);
    for (auto& [worker, leases] : held_) {
      if (class_of_worker_.at(worker) == bound) continue;
      for (const ModelLease& lease : leases) {
        if (lease.unit.job == job) void_.emplace_back(worker, lease);
      }
      std::erase_if(leases, [&](const ModelLease& lease) { return lease.unit.job == job; });
    }
  }

  void DeliverVoid() {
    if (void_.empty()) return;
    const auto& [worker, lease] = void_[static_cast<size_t>(Draw(static_cast<int>(void_.size())))];
    const Completion completion = scheduler_->CompleteUnit(worker, lease.unit, lease.attempt, now_);
    EXPECT_EQ(completion, commits_.contains(lease.unit) ? Completion::kDuplicate : Completion::kStale);
  }

  void Fail() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (leases.empty()) return;
    const ModelLease lease = leases.back();
    leases.pop_back();
    EXPECT_EQ(scheduler_->FailUnit(worker, lease.unit, lease.attempt, false, now_), FailureOutcome::kRetried);
    void_.emplace_back(worker, lease);
  }

  std::mt19937 random_;
  absl::Time now_ = absl::FromUnixSeconds(1'000'000);
  std::map<JobId, v1::JobSpec> specs_;
  std::unique_ptr<Scheduler> scheduler_;
  int64_t next_worker_ = 1;
  int64_t last_attempt_ = 0;
  std::map<WorkerId, std::vector<ModelLease>> held_;
  std::vector<std::pair<WorkerId, ModelLease>> void_;
  int max_lost_workers_;
  int second_leases_ = 0;  // of overdue units
  int quarantines_ = 0;
  std::map<WorkerId, std::string> class_of_worker_;
  std::map<JobId, std::string> class_of_job_;  // empty before the first commit
  std::map<UnitRef, int> commits_;             // the contents of the ledger
};

class SchedulerRandom : public ::testing::TestWithParam<uint32_t> {};

TEST_P(SchedulerRandom, CommitsEachUnitExactlyOnceWhateverHappens) { RandomHistory(GetParam()).Run(); }

TEST(SchedulerRandomHistory, TheHistoriesHaveOverdueUnitsAndQuarantine) {
  int second_leases = 0;
  int quarantines = 0;
  for (uint32_t seed = 0; seed < 30; ++seed) {
    RandomHistory history(seed);
    history.Run();
    second_leases += history.second_leases();
    quarantines += history.quarantines();
  }
  EXPECT_GT(second_leases, 0);
  EXPECT_GT(quarantines, 0);
}

INSTANTIATE_TEST_SUITE_P(Seeds, SchedulerRandom, ::testing::Range(0u, 30u));

}  // namespace
}  // namespace lumifold::scheduler
