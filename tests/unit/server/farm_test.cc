// The farm's state without a disk, a network or a thread.
#include "server/coordinator/farm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/coordinator/explain.h"
#include "server/job/job_spec.h"
#include "server/job/plan.h"
#include "server/picture/picture_code.h"
#include "tests/support/made_up_plan.h"
#include "tests/support/temp_folder.h"

namespace lumifold::server {
namespace {

using job::JobId;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;
using testing::SizeIs;

/// Notes what the farm asks for.
class NotedEffects final : public FarmEffects {
 public:
  void RecordEnd(const JobId& job, v1::JobState state, const std::string& error) override {
    ends.emplace_back(job, state);
    errors.push_back(error);
  }
  void CancelFinishing(const JobId& job) override { cancelled.push_back(job); }
  void DiscardUnits(const FrameKey& frame, const std::vector<job::UnitKey>& units) override {
    discarded[frame] += units.size();
  }
  void RecordBlock(const std::string& name, const std::string& /*reason*/) override { blocked.insert(name); }
  void SkipFrame(const FrameKey& frame, const std::string& /*cause*/) override { skipped.push_back(frame); }
  void KeepPrerequisites(const std::set<JobId>& jobs) override { kept = jobs; }
  void WakeHousekeeping() override { ++housekeeping; }
  void WakeFinisher() override { ++finisher; }

  std::vector<std::pair<JobId, v1::JobState>> ends;
  std::vector<std::string> errors;
  std::vector<JobId> cancelled;
  std::map<FrameKey, size_t> discarded;
  std::set<std::string> blocked;
  std::vector<FrameKey> skipped;
  std::set<JobId> kept;
  int housekeeping = 0;
  int finisher = 0;
};

class NotingSink final : public WorkerSink {
 public:
  void Send(const v1::CoordinatorMessage& message) override {
    for (const v1::Lease& lease : message.grant().leases()) leases.push_back(lease);
    for (const v1::Lease& lease : message.void_leases().leases()) revoked.push_back(lease);
    if (message.has_job_ended()) ended.push_back(message.job_ended().job_id());
    if (message.has_grant()) trace = message.grant().trace_id();
  }
  /// Leases of a job that it has got.
  int Count(const JobId& job) const {
    return static_cast<int>(std::count_if(leases.begin(), leases.end(), [&](const v1::Lease& lease) {
      return lease.unit().job_id() == job.value();
    }));
  }

  std::vector<v1::Lease> leases;
  std::vector<v1::Lease> revoked;
  std::vector<std::string> ended;
  std::string trace;  // of the last grant
};

CoordinatorOptions Options(const absl::Time* now) {
  CoordinatorOptions options;
  options.now = [now] { return *now; };
  options.wall_now = [now] { return *now; };
  options.log = std::make_shared<spdlog::logger>("none");
  return options;
}

/// Of workers that may finish frames, too.
std::string FarmClass() { return absl::StrCat("c-", PictureCode(), "-"); }

class FarmTest : public testing::Test {
 protected:
  FarmTest()
      : resources_(Options(&now_), DataFolder(folder_.PathOf("data")), nullptr, nullptr, nullptr,
                   {"owner", ledger::Epoch(1)}),
        farm_(&resources_, &effects_) {
    farm_.LimitFrames(uint64_t{1} << 40);
  }

  /// One frame without a plan unit.
  static v1::JobSpec Spec() {
    v1::JobSpec spec;
    spec.mutable_scene()->mutable_file()->set_sha256(std::string(64, 'a'));
    spec.set_frame_count(1);
    spec.set_width(16);
    spec.set_height(8);
    spec.set_tile_size(8);
    spec.set_samples_per_pixel(4);
    spec.set_pass_samples(4);
    spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
    return spec;
  }
  static ledger::JobRecord Record(const std::string& id, const v1::JobSpec& spec = Spec()) {
    ledger::JobRecord record;
    record.id = JobId(id);
    const absl::StatusOr<v1::JobSpec> normal = job::NormaliseJobSpec(spec);
    EXPECT_TRUE(normal.ok()) << normal.status();
    if (normal.ok()) record.spec = *normal;
    return record;
  }
  JobId Start(const std::string& id, const std::vector<job::Prerequisite>& after = {}) {
    farm_.StartJob(Record(id), after);
    farm_.Complete();
    return JobId(id);
  }
  job::WorkerId Connect(const std::string& name, int slots) {
    const job::WorkerId worker = farm_.workers.Add({.name = name, .slots = slots, .sink = &sinks_[name]});
    farm_.scheduler.workers().Add(worker, {.name = name, .numeric_class = FarmClass(), .slots = slots});
    farm_.Complete();
    return worker;
  }
  void Pause(const JobId& job, bool paused) {
    farm_.jobs.FindActive(job)->record.scheduling.set_paused(paused);
    farm_.UpdatePause(job);
    farm_.Complete();
  }
  void EndWell(const JobId& job) {
    farm_.Settle(farm_.dependencies.Ended(job, v1::JOB_STATE_DONE));
    farm_.Complete();
  }
  void Want(const JobId& job, const std::string& sha256) {
    farm_.jobs.FindActive(job)->wanted_asset.emplace().set_sha256(sha256);
    farm_.UpdatePause(job);
  }
  int Leases(const JobId& job) { return sinks_["worker"].Count(job); }

  absl::Time now_ = absl::FromUnixSeconds(1000);
  TempFolder folder_;
  Resources resources_;
  NotedEffects effects_;
  std::map<std::string, NotingSink> sinks_;
  Farm farm_;
};

TEST_F(FarmTest, AChangeGrantsWhatItFreed) {
  const JobId job = Start("j-1");
  EXPECT_EQ(effects_.housekeeping, 0);
  Connect("worker", 2);
  EXPECT_EQ(Leases(job), 2);
  EXPECT_EQ(effects_.housekeeping, 1) << "watchers are told";
  farm_.Complete();
  EXPECT_EQ(effects_.housekeeping, 1) << "nothing has changed";
  EXPECT_EQ(farm_.jobs.FindActive(job)->record.started, now_);
}

TEST_F(FarmTest, GrantsNothingWhileItDrains) {
  farm_.phase = Farm::Phase::kDraining;
  const JobId job = Start("j-1");
  Connect("worker", 2);
  EXPECT_EQ(Leases(job), 0);
}

TEST_F(FarmTest, GrantsNothingWhileTheStorageFails) {
  resources_.storage.Fail(absl::UnavailableError("full"));
  const JobId job = Start("j-1");
  Connect("worker", 2);
  EXPECT_EQ(Leases(job), 0);
  resources_.storage.Recover();
  farm_.Complete();
  EXPECT_EQ(Leases(job), 2);
}

// A job gets leases where none of three causes holds it up: each pair, ended in either order.

TEST_F(FarmTest, AJobThatWaitsIsNotStartedByItsUser) {
  const JobId job = Start("j-2", {{JobId("j-1"), v1::JOB_STATE_RUNNING}});
  EXPECT_THAT(effects_.kept, ElementsAre(JobId("j-1")));
  Connect("worker", 2);
  Pause(job, true);
  Pause(job, false);
  EXPECT_EQ(Leases(job), 0);
  EndWell(JobId("j-1"));
  EXPECT_EQ(Leases(job), 2);
  EXPECT_THAT(effects_.kept, IsEmpty());
}

TEST_F(FarmTest, AJobThatItsUserPausedIsNotStartedByAnotherJob) {
  const JobId job = Start("j-2", {{JobId("j-1"), v1::JOB_STATE_RUNNING}});
  Connect("worker", 2);
  Pause(job, true);
  EndWell(JobId("j-1"));
  EXPECT_EQ(Leases(job), 0);
  Pause(job, false);
  EXPECT_EQ(Leases(job), 2);
}

TEST_F(FarmTest, AJobThatWaitsForAFileIsNotStartedByItsUser) {
  const JobId job = Start("j-1");
  Want(job, "f");
  Connect("worker", 2);
  Pause(job, true);
  Pause(job, false);
  EXPECT_EQ(Leases(job), 0);
  farm_.OnAssetFound("another");
  farm_.Complete();
  EXPECT_EQ(Leases(job), 0);
  farm_.OnAssetFound("f");
  farm_.Complete();
  EXPECT_EQ(Leases(job), 2);
}

TEST_F(FarmTest, AJobThatItsUserPausedIsNotStartedByAFile) {
  const JobId job = Start("j-1");
  Want(job, "f");
  Connect("worker", 2);
  Pause(job, true);
  farm_.OnAssetFound("f");
  farm_.Complete();
  EXPECT_EQ(Leases(job), 0);
  Pause(job, false);
  EXPECT_EQ(Leases(job), 2);
}

TEST_F(FarmTest, AJobThatWaitsForAnotherAndAFileNeedsBoth) {
  for (const bool file_first : {true, false}) {
    const std::string name = file_first ? "j-2" : "j-3";
    const JobId job = Start(name, {{JobId("j-1"), v1::JOB_STATE_RUNNING}});
    Want(job, "f");
    if (file_first) Connect("worker", 8);
    const auto come = [&](bool file) {
      if (file) {
        farm_.OnAssetFound("f");
        farm_.Complete();
      } else {
        EndWell(JobId("j-1"));
      }
    };
    come(file_first);
    EXPECT_EQ(Leases(job), 0) << name;
    come(!file_first);
    EXPECT_EQ(Leases(job), 4) << name;
  }
}

TEST_F(FarmTest, SaysEachCauseThatHoldsAJobUp) {
  const JobId job = Start("j-2", {{JobId("j-1"), v1::JOB_STATE_RUNNING}});
  Want(job, "f");
  Pause(job, true);
  const auto codes = [&] {
    v1::ExplainJobResponse response;
    ExplainWaiting(farm_, job, now_, &response);
    std::set<std::string> found;
    for (const v1::Reason& reason : response.reasons()) found.insert(reason.code());
    return found;
  };
  EXPECT_THAT(codes(), testing::IsSupersetOf({"after", "asset", "paused"}));
  Pause(job, false);
  EXPECT_THAT(codes(), testing::Not(testing::Contains("paused")));
  EXPECT_EQ(farm_.StatusOf(job)->state(), v1::JOB_STATE_SUBMITTED);
  EXPECT_EQ(farm_.LeasesWanted(job), 0);
  farm_.OnAssetFound("f");
  EXPECT_EQ(farm_.LeasesWanted(job), 0);
  EndWell(JobId("j-1"));
  EXPECT_GT(farm_.LeasesWanted(job), 0);
}

TEST_F(FarmTest, SaysWhichFramesOfAJobAreInTheFilterAndHowManyWaitForIt) {
  const JobId job = Start("j-1");
  const auto queue = [&](const std::string& id, int32_t number, absl::Duration until_due, int failures) {
    farm_.frames.Push(
        {.job = JobId(id), .number = number, .failures = failures, .not_before = now_ + until_due});
  };
  const auto reasons = [&] {
    v1::ExplainJobResponse response;
    ExplainWaiting(farm_, job, now_, &response);
    std::vector<std::string> found;
    for (const v1::Reason& reason : response.reasons()) {
      if (reason.code().starts_with("filter")) found.push_back(reason.code() + ": " + reason.text());
    }
    return found;
  };
  EXPECT_THAT(reasons(), IsEmpty());
  Start("j-9");
  queue("j-9", 7, absl::Seconds(9), 0);  // it waits for the storage, and nobody for it
  queue("j-1", 1, absl::Seconds(5), 0);
  EXPECT_THAT(reasons(), ElementsAre("filter_queue: frame 1 waits for the filter, which has 0 frames of this "
                                     "and other jobs; 0 wait"));
  farm_.frames.ForgetJob(job);
  farm_.frames.AddJob(job, {});
  queue("j-9", 8, absl::ZeroDuration(), 0);
  queue("j-1", 3, absl::Milliseconds(2500), 2);
  queue("j-1", 2, absl::ZeroDuration(), 2);
  queue("j-1", 4, absl::ZeroDuration(), 0);
  EXPECT_THAT(
      reasons(),
      ElementsAre("filter_retry: the filter of frame 3 failed 2 times and is tried again in 3 s",
                  "filter_queue: frame 2 waits for the filter, which has 0 frames of this and other jobs; 3 "
                  "wait"));
  ASSERT_EQ(farm_.frames.Begin(now_)->due.job, JobId("j-9"));
  farm_.frames.End({{JobId("j-9"), 8}}, now_);
  ASSERT_EQ(farm_.frames.Begin(now_)->due.number, 2);
  now_ += absl::Seconds(2);
  EXPECT_THAT(
      reasons(),
      ElementsAre("filter_running: frame 2 has been in the filter for 2 s, on 1 thread",
                  "filter_retry: the filter of frame 3 failed 2 times and is tried again in 1 s",
                  "filter_queue: frame 4 waits for the filter, which has 1 frames of this and other jobs; 1 "
                  "wait"));
}

TEST_F(FarmTest, CountsWhatACommittedUnitAddsToItsJobAlsoWhileThatEnds) {
  const JobId job = Start("j-1");
  const job::WorkerId worker = Connect("worker", 3);
  const auto commit = [&](size_t lease, int64_t number) {
    const v1::Lease& granted = sinks_["worker"].leases[lease];
    AcceptedUnit unit;
    unit.worker = worker;
    unit.samples = 10 * number;
    unit.record_bytes = static_cast<uint64_t>(100 * number);
    unit.stored.unit = job::UnitFromProto(granted.unit());
    unit.stored.stats.set_bad_samples(number);
    unit.stored.stats.add_warnings("no light");
    if (farm_.scheduler.jobs().Has(job)) {
      EXPECT_EQ(farm_.scheduler.units().Complete(worker, unit.stored.unit, job::Attempt(granted.attempt()),
                                                 now_, ""),
                scheduler::Completion::kAccepted);
    }
    farm_.CountCommitted(unit);
    return unit.stored.unit;
  };
  ASSERT_EQ(Leases(job), 3);
  now_ += absl::Seconds(7);
  const job::UnitRef first = commit(0, 1);
  now_ += absl::Seconds(2);
  commit(1, 2);
  EXPECT_EQ(farm_.totals.units_committed, 2);
  EXPECT_EQ(farm_.totals.samples_committed, 30);
  const ActiveJob& active = *farm_.jobs.FindActive(job);
  EXPECT_EQ(active.unit_bytes.units, 2);
  EXPECT_EQ(active.unit_bytes.bytes, 300u);
  v1::JobStatus status = *farm_.StatusOf(job);
  EXPECT_EQ(status.units_done(), 2);
  EXPECT_EQ(status.bad_samples(), 3);
  EXPECT_EQ(status.times().render_seconds(), 9);
  EXPECT_THAT(status.warnings(), SizeIs(1));
  ledger::UnitRecord lost;
  lost.unit = first;
  lost.bad_samples = 1;
  farm_.RevokeUnits(job, {lost});
  status = *farm_.StatusOf(job);
  EXPECT_EQ(status.units_done(), 1);
  EXPECT_EQ(status.bad_samples(), 2);
  farm_.EndJob(job, v1::JOB_STATE_CANCELLED, "");
  const int64_t samples = farm_.jobs.FindEnding(job)->record.done.samples;
  commit(2, 3);
  EXPECT_EQ(farm_.totals.units_committed, 3);
  const ledger::JobRecord& ended = farm_.jobs.FindEnding(job)->record;
  EXPECT_EQ(ended.done.units, 2);
  EXPECT_EQ(ended.done.samples, samples + 30);
  EXPECT_EQ(ended.done.bad_samples, 5);
}

// A plan makes more passes of a frame than the job was taken to have, and they need more room on the disk.
TEST_F(FarmTest, APlanBoundsTheFramesInFlight) {
  v1::JobSpec spec = Spec();
  spec.set_frame_count(2);
  spec.set_samples_per_pixel(16);
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_AUTO);
  spec.clear_tile_size();
  spec.clear_pass_samples();
  const job::WorkerId worker = Connect("worker", 64);
  for (const int frames : {2, 1}) {
    const ledger::JobRecord record = Record(absl::StrCat("j-", frames), spec);
    const v1::JobSpec planned =
        *job::PlannedSpec(record.spec, MadeUpPlan(/*tile_size=*/8, /*pass_samples=*/2));
    const job::FrameUnits units(planned);
    ASSERT_EQ(units.pass_count(), 8);
    const FrameDemand demand = DemandOf(planned, units, {});
    farm_.LimitFrames(static_cast<uint64_t>(2 * frames) * demand.log_bytes);
    farm_.StartJob(record, {});
    farm_.Complete();
    ASSERT_EQ(Leases(record.id), 1) << "that of the plan";
    const v1::Lease lease = sinks_["worker"].leases.back();
    const job::UnitRef unit = job::UnitFromProto(lease.unit());
    farm_.scheduler.units().Complete(worker, unit, job::Attempt(lease.attempt()), now_, "");
    farm_.SetPlan(unit, planned);
    farm_.Complete();
    EXPECT_EQ(Leases(record.id), 1 + frames * units.count());
    farm_.EndJob(record.id, v1::JOB_STATE_CANCELLED, "");
    farm_.Complete();
  }
}

class FarmFinishTest : public FarmTest {
 protected:
  /// Three jobs whose only frame is rendered, and a worker that finishes frames.
  FarmFinishTest() {
    worker_ = Connect("worker", 64);
    farm_.finish_leases.AddWorker(
        worker_, {.numeric_class = FarmClass(), .places = 1, .memory_bytes = uint64_t{1} << 40});
    for (const char* id : {"j-1", "j-2", "j-3"}) {
      ledger::JobRecord record = Record(id);
      record.scheduling.set_trace_id(std::string("trace of ") + id);
      farm_.StartJob(record, {});
      farm_.Complete();
    }
    EXPECT_EQ(sinks_["worker"].trace, "trace of j-3");
    for (const v1::Lease& lease : std::vector<v1::Lease>(sinks_["worker"].leases)) {
      AcceptedUnit unit;
      unit.stored.unit = job::UnitFromProto(lease.unit());
      farm_.scheduler.units().Complete(worker_, unit.stored.unit, job::Attempt(lease.attempt()), now_, "");
      farm_.CountCommitted(unit);
    }
    sinks_["worker"].leases.clear();
  }

  /// The lease to finish a frame that the worker got last.
  const v1::Lease& Last() { return sinks_["worker"].leases.back(); }
  bool Holds(const JobId& job) {
    return farm_.finish_leases.Find(worker_, {{job, 0}}, job::Attempt(Last().attempt())) != nullptr;
  }

  job::WorkerId worker_;
  const JobId first_{"j-1"};
  const JobId second_{"j-2"};
};

TEST_F(FarmFinishTest, AFrameWithoutAPlaceGoesToAWorkerThatHasOne) {
  const std::optional<RunningFrame> here = farm_.BeginFrame(now_);
  ASSERT_TRUE(here.has_value());
  EXPECT_EQ(here->worker, std::nullopt);
  const std::optional<RunningFrame> away = farm_.BeginFrame(now_);
  ASSERT_TRUE(away.has_value());
  EXPECT_EQ(away->worker, worker_);
  EXPECT_EQ(away->due.job, second_);
  EXPECT_EQ(Last().unit().job_id(), "j-2");
  EXPECT_EQ(Last().unit().kind(), v1::UNIT_KIND_RESULT);
  EXPECT_EQ(sinks_["worker"].trace, "trace of j-2");
  EXPECT_TRUE(Holds(second_));
  EXPECT_FALSE(farm_.BeginFrame(now_).has_value()) << "neither has a place left";
  EXPECT_EQ(farm_.StatusOf(second_)->frames_filtering(), 1);
  farm_.frames.SetFiltered(away->part(), 0.25);
  EXPECT_EQ(farm_.StatusOf(second_)->frames_filtered(), 0.25);
  EXPECT_EQ(farm_.StatusOf(here->due.job)->frames_filtered(), 0);
  EXPECT_EQ(farm_.StatusOf(JobId("j-3"))->frames_waiting(), 1);
  v1::ExplainJobResponse response;
  ExplainWaiting(farm_, second_, now_ + absl::Seconds(3), &response);
  EXPECT_EQ(response.reasons(response.reasons_size() - 1).text(),
            "frame 0 has been with worker w-1/worker for 3 s, which filters it");
}

TEST_F(FarmFinishTest, WhatAWorkerDoesNotFinishComesBack) {
  farm_.BeginFrame(now_);
  farm_.BeginFrame(now_);
  now_ += absl::Seconds(30);
  farm_.frames.End({{first_, 0}}, now_);
  const std::optional<RunningFrame> again = farm_.BeginFrame(now_);
  ASSERT_TRUE(again.has_value());
  EXPECT_EQ(again->due.job, second_);
  EXPECT_EQ(again->worker, std::nullopt) << "it stays here now";
  EXPECT_FALSE(Holds(second_)) << "the lease has expired";
  EXPECT_EQ(sinks_["worker"].revoked.back().unit().kind(), v1::UNIT_KIND_RESULT);
  EXPECT_EQ(farm_.finish_leases.size(), 0);
}

TEST_F(FarmFinishTest, TheEndOfAJobEndsItsLease) {
  farm_.BeginFrame(now_);
  farm_.BeginFrame(now_);
  farm_.EndJob(second_, v1::JOB_STATE_CANCELLED, "");
  EXPECT_EQ(farm_.finish_leases.size(), 0);
  EXPECT_FALSE(farm_.frames.IsFinishing(second_));
  EXPECT_EQ(farm_.BeginFrame(now_)->due.job, JobId("j-3"));
}

TEST_F(FarmFinishTest, ABlockedWorkerHasNoFrames) {
  farm_.BeginFrame(now_);
  farm_.BeginFrame(now_);
  farm_.scheduler.workers().Block("worker", "it delivered wrong pixels");
  EXPECT_FALSE(farm_.BeginFrame(now_).has_value());
  EXPECT_EQ(farm_.finish_leases.size(), 0);
  EXPECT_EQ(farm_.StatusOf(second_)->frames_waiting(), 1);
}

TEST_F(FarmFinishTest, AnAuditedFrameIsMadeAgainByAnotherWorker) {
  farm_.BeginFrame(now_);
  const std::optional<RunningFrame> sent = farm_.BeginFrame(now_);
  ASSERT_TRUE(sent.has_value());
  ASSERT_EQ(sent->worker, worker_);
  farm_.finish_leases.End(job::Attempt(Last().attempt()));
  farm_.frames.Audit(sent->part(), {farm_.workers.Find(worker_)->name, "digest"}, now_);
  EXPECT_EQ(farm_.BeginFrame(now_)->due.job, JobId("j-3")) << "it may not confirm itself";
  EXPECT_FALSE(farm_.BeginFrame(now_).has_value());
  const job::WorkerId other = Connect("other", 1);
  farm_.finish_leases.AddWorker(
      other, {.numeric_class = FarmClass(), .places = 1, .memory_bytes = uint64_t{1} << 40});
  const std::optional<RunningFrame> again = farm_.BeginFrame(now_);
  ASSERT_TRUE(again.has_value());
  EXPECT_EQ(again->worker, other);
  EXPECT_EQ(again->due.key(), sent->due.key());
}

TEST(PictureCode, AClassNamesTheCodeOfPictures) {
  EXPECT_TRUE(SharesPictureCode(FarmClass()));
  EXPECT_FALSE(SharesPictureCode("c-"));
  EXPECT_FALSE(SharesPictureCode(""));
  // Of devices of other bits.
  const std::string other = absl::StrCat("c-", PictureCode(), "+12345678-");
  EXPECT_FALSE(SharesPictureCode(other));
  EXPECT_FALSE(SharesPictureCode(FarmClass(), "12345678"));
  EXPECT_TRUE(SharesPictureCode(other, "12345678"));
  EXPECT_FALSE(SharesPictureCode(other, "87654321"));
  EXPECT_EQ(ClassOfPicture("c-d", ""), "c-d");
  EXPECT_EQ(ClassOfPicture("c-d", "12345678"), "c-d+12345678");
  EXPECT_EQ(ClassOfPicture(other, "12345678"), other);
}

TEST_F(FarmTest, TheEndOfAJobLeavesNothingOfItBehind) {
  const JobId job = Start("j-1");
  Connect("worker", 2);
  farm_.frames.Push({.job = job, .number = 1});
  farm_.EndJob(job, v1::JOB_STATE_CANCELLED, "two\nlines");
  farm_.Complete();
  EXPECT_THAT(effects_.ends, ElementsAre(Pair(job, v1::JOB_STATE_CANCELLED)));
  EXPECT_THAT(effects_.errors, ElementsAre("two lines"));
  EXPECT_THAT(effects_.cancelled, ElementsAre(job));
  EXPECT_THAT(sinks_["worker"].ended, ElementsAre("j-1"));
  EXPECT_THAT(sinks_["worker"].revoked, IsEmpty()) << "the end says so";
  EXPECT_THAT(farm_.frames.waiting(), IsEmpty());
  EXPECT_FALSE(farm_.scheduler.jobs().Has(job));
  EXPECT_TRUE(farm_.jobs.IsInMemory(job)) << "until the end is recorded";
  EXPECT_EQ(farm_.StatusOf(job)->workers(), 0);
  farm_.EndJob(job, v1::JOB_STATE_FAILED, "again");
  EXPECT_THAT(effects_.ends, SizeIs(1));
}

TEST_F(FarmTest, AFrameThatFailsFailsItsJobOrIsSkippedOnce) {
  for (const bool skips : {false, true}) {
    ledger::JobRecord record = Record(skips ? "j-2" : "j-1");
    const JobId job = record.id;
    record.spec.set_frame_count(3);
    record.scheduling.mutable_gaps()->set_skip_failed(skips);
    farm_.StartJob(record, {});
    for (int i = 0; i < 2; ++i) farm_.FailFrame({job, 1}, "no such texture");
    EXPECT_EQ(farm_.jobs.FindActive(job) == nullptr, !skips);
  }
  EXPECT_THAT(effects_.ends, ElementsAre(Pair(JobId("j-1"), v1::JOB_STATE_FAILED)));
  EXPECT_EQ(farm_.jobs.FindEnding(JobId("j-1"))->record.scheduling.gaps().failed_frame(), 1);
  EXPECT_THAT(effects_.skipped, ElementsAre(FrameKey(JobId("j-2"), 1)));
  farm_.jobs.FindActive(JobId("j-2"))->skipping.clear();
  farm_.FailFrame({JobId("j-2"), 1}, "no such texture");
  EXPECT_THAT(effects_.skipped, SizeIs(2)) << "it could not be skipped the first time";
  farm_.FailFrame({JobId("j-2"), 0}, "no such texture");
  farm_.FailFrame({JobId("j-2"), 2}, "no such texture");
  EXPECT_THAT(effects_.ends, SizeIs(2)) << "no frame would be left";
}

TEST_F(FarmTest, AJobThatSkipsFramesEndsWithGaps) {
  LoadedJob loaded;
  loaded.record = Record("j-1");
  loaded.record.spec.set_frame_count(3);
  loaded.finished = {0, 2};
  loaded.record.scheduling.mutable_gaps()->add_skipped()->set_first(1);
  loaded.record.scheduling.mutable_gaps()->mutable_skipped(0)->set_count(1);
  farm_.EnterJob(loaded);
  EXPECT_THAT(effects_.ends, ElementsAre(Pair(JobId("j-1"), v1::JOB_STATE_DONE_WITH_GAPS)));
}

TEST_F(FarmTest, AJobOfHopelessPrerequisitesFails) {
  Start("j-2", {{JobId("j-1"), v1::JOB_STATE_FAILED}});
  EXPECT_THAT(effects_.ends, ElementsAre(Pair(JobId("j-2"), v1::JOB_STATE_FAILED)));
  Start("j-4", {{JobId("j-3"), v1::JOB_STATE_RUNNING}});
  farm_.Settle(farm_.dependencies.Ended(JobId("j-3"), v1::JOB_STATE_CANCELLED));
  EXPECT_THAT(effects_.ends, SizeIs(2));
}

TEST_F(FarmTest, ASuspendedJobShowsWhatItShowedLast) {
  const JobId job = Start("j-1");
  Connect("worker", 2);
  ASSERT_EQ(farm_.StatusOf(job)->workers(), 1);
  farm_.SuspendJob(job, {});
  EXPECT_EQ(farm_.StatusOf(job)->job_id(), "j-1");
  EXPECT_EQ(farm_.StatusOf(job)->workers(), 0);
  EXPECT_FALSE(farm_.scheduler.jobs().Has(job));
  EXPECT_THAT(effects_.ends, IsEmpty());
  v1::JobStatus shown;
  shown.set_job_id("j-2");
  farm_.SuspendJob(JobId("j-2"), shown);
  EXPECT_EQ(farm_.StatusOf(JobId("j-2"))->job_id(), "j-2");
}

}  // namespace
}  // namespace lumifold::server
