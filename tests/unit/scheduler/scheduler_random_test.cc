// Random histories checked against a model of the rules: for any events in any order each unit is committed
// exactly once, no unit is lost, a void lease delivers nothing, all units of a job are of one numeric class, and a
// restart at any time preserves this.
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

struct HeldLease {
  UnitRef unit;
  Attempt attempt;
  absl::Time deadline;
};

class RandomHistory {
 public:
  explicit RandomHistory(uint32_t seed) : random_(seed) {
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
    scheduler_ = std::make_unique<Scheduler>(SchedulerOptions{
        .lease = absl::Seconds(20), .max_failures = 1'000'000, .first_attempt = Attempt(last_attempt_ + 1)});
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

  void MakeVoid(WorkerId worker, std::vector<HeldLease>* leases) {
    for (const HeldLease& lease : *leases) void_.emplace_back(worker, lease);
    leases->clear();
  }

  void Expire() {
    absl::Time next = absl::InfiniteFuture();
    for (const auto& [worker, leases] : held_) {
      for (const HeldLease& lease : leases) next = std::min(next, lease.deadline);
    }
    EXPECT_EQ(scheduler_->NextExpiry(), next);
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
    std::vector<std::pair<UnitRef, Attempt>> named;
    for (HeldLease& lease : leases) {
      named.emplace_back(lease.unit, lease.attempt);
      lease.deadline = now_ + absl::Seconds(20);
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
      for (const auto& [other, theirs] : held_) {
        for (const HeldLease& held : theirs) EXPECT_NE(held.unit, lease.unit) << "two leases of one unit";
      }
      held_.at(lease.worker).push_back({lease.unit, lease.attempt, now_ + absl::Seconds(20)});
    }
    for (const auto& [worker, leases] : held_) EXPECT_LE(leases.size(), static_cast<size_t>(kSlots));
  }

  void Deliver() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (leases.empty()) return;
    const HeldLease lease = leases[static_cast<size_t>(Draw(static_cast<int>(leases.size())))];
    std::erase_if(leases, [&](const HeldLease& held) { return held.attempt == lease.attempt; });
    ASSERT_EQ(scheduler_->CompleteUnit(worker, lease.unit, lease.attempt), Completion::kAccepted);
    void_.emplace_back(worker, lease);  // a second delivery is a duplicate
    BindTo(lease.unit.job, class_of_worker_.at(worker));
    scheduler_->UnitCommitted(lease.unit);
    ++commits_[lease.unit];
  }

  void BindTo(const JobId& job, const std::string& numeric_class) {
    std::string& bound = class_of_job_[job];
    EXPECT_TRUE(bound.empty() || bound == numeric_class);
    bound = numeric_class;
    EXPECT_EQ(scheduler_->NumericClassOf(job), bound);
    for (auto& [worker, leases] : held_) {
      if (class_of_worker_.at(worker) == bound) continue;
      for (const HeldLease& lease : leases) {
        if (lease.unit.job == job) void_.emplace_back(worker, lease);
      }
      std::erase_if(leases, [&](const HeldLease& lease) { return lease.unit.job == job; });
    }
  }

  void DeliverVoid() {
    if (void_.empty()) return;
    const auto& [worker, lease] = void_[static_cast<size_t>(Draw(static_cast<int>(void_.size())))];
    const Completion completion = scheduler_->CompleteUnit(worker, lease.unit, lease.attempt);
    EXPECT_EQ(completion, commits_.contains(lease.unit) ? Completion::kDuplicate : Completion::kStale);
  }

  void Fail() {
    auto& [worker, leases] = *std::next(held_.begin(), Draw(kWorkers));
    if (leases.empty()) return;
    const HeldLease lease = leases.back();
    leases.pop_back();
    EXPECT_EQ(scheduler_->FailUnit(worker, lease.unit, lease.attempt, false), FailureOutcome::kRetried);
    void_.emplace_back(worker, lease);
  }

  std::mt19937 random_;
  absl::Time now_ = absl::FromUnixSeconds(1'000'000);
  std::map<JobId, v1::JobSpec> specs_;
  std::unique_ptr<Scheduler> scheduler_;
  int64_t next_worker_ = 1;
  int64_t last_attempt_ = 0;
  std::map<WorkerId, std::vector<HeldLease>> held_;
  std::vector<std::pair<WorkerId, HeldLease>> void_;
  std::map<WorkerId, std::string> class_of_worker_;
  std::map<JobId, std::string> class_of_job_;  // empty before the first commit
  std::map<UnitRef, int> commits_;             // the contents of the ledger
};

class SchedulerRandom : public ::testing::TestWithParam<uint32_t> {};

TEST_P(SchedulerRandom, CommitsEachUnitExactlyOnceWhateverHappens) { RandomHistory(GetParam()).Run(); }

INSTANTIATE_TEST_SUITE_P(Seeds, SchedulerRandom, ::testing::Range(0u, 30u));

}  // namespace
}  // namespace lumifold::scheduler
