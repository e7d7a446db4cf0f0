// What every JobStore does, whatever its database.
#include "server/ledger/job_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "absl/strings/str_cat.h"
#include "server/job/limits.h"
#include "tests/support/made_up_plan.h"
#include "tests/unit/ledger/job_store_fixture.h"

namespace lumifold::ledger {
namespace {

using absl::StatusCode;
using job::JobId;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

INSTANTIATE_TEST_SUITE_P(All, JobStoreTest, ::testing::ValuesIn(DatabaseKinds()),
                         [](const auto& kind) { return kind.param.name; });

std::string Text(const absl::Status& status) { return std::string(status.message()); }

TEST_P(JobStoreTest, KeepsJobsAcrossReopening) {
  const NewJob job = Job("j-a", "r-1");
  ASSERT_EQ(*store_->CreateJob(job), job.id);
  Reopen();
  const JobRecord record = Get("j-a");
  EXPECT_EQ(record.id, job.id);
  EXPECT_EQ(record.spec.SerializeAsString(), job.spec.SerializeAsString());
  EXPECT_EQ(record.scheduling.user(), "ann");
  EXPECT_EQ(record.owner, job.owner);
  EXPECT_EQ(record.state, v1::JOB_STATE_SUBMITTED);
  EXPECT_EQ(record.submitted, kStart);
  EXPECT_EQ(record.started, absl::InfinitePast());
  EXPECT_EQ(store_->GetJob(JobId("j-b")).status().code(), StatusCode::kNotFound);
}

TEST_P(JobStoreTest, EpochsIncreaseAcrossReopeningAndStayAboveAFloor) {
  const Epoch first = *store_->NewEpoch();
  EXPECT_GT(first, Epoch());
  Reopen();
  const Epoch second = *store_->NewEpoch();
  EXPECT_GT(second, first);
  EXPECT_EQ(*store_->NewEpoch(Epoch(500)), Epoch(501));
  EXPECT_EQ(*store_->NewEpoch(Epoch(7)), Epoch(502));
  EXPECT_GT(FirstAttempt(second), FirstAttempt(first));
  EXPECT_EQ(EpochOf(job::Attempt(FirstAttempt(second).value() + 1'000'000)), second);
}

TEST_P(JobStoreTest, OneRequestMakesOneJob) {
  EXPECT_EQ(*store_->FindRequest(Job("j-a", "r-1")), std::nullopt);
  EXPECT_EQ(*store_->CreateJob(Job("j-a", "r-1")), JobId("j-a"));
  EXPECT_EQ(*store_->CreateJob(Job("j-b", "r-1")), JobId("j-a"));
  EXPECT_EQ(*store_->CreateJob(Job("j-c", "r-2")), JobId("j-c"));
  EXPECT_EQ(*store_->FindRequest(Job("", "r-1")), JobId("j-a"));
  EXPECT_EQ(*store_->FindRequest(Job("", "r-3")), std::nullopt);
  NewJob of_another_trace = Job("j-d", "r-1");
  of_another_trace.scheduling.set_trace_id("4bf92f3577b34da6a3ce929d0e0e4736");
  EXPECT_EQ(*store_->FindRequest(of_another_trace), JobId("j-a"));
  EXPECT_EQ(*store_->CreateJob(of_another_trace), JobId("j-a"));
  EXPECT_THAT(Listed({}), SizeIs(2));
}

TEST_P(JobStoreTest, ARequestIdOfAnotherSpecOrSchedulingIsRefused) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  NewJob other_spec = Job("j-b", "r-1");
  other_spec.spec.set_seed(1);
  NewJob other_file = Job("j-b", "r-1");
  other_file.spec.mutable_scene()->mutable_dependencies(0)->set_uri("stone.png");
  NewJob other_scheduling = Job("j-b", "r-1");
  other_scheduling.scheduling.set_priority(1);
  for (const NewJob& job : {other_spec, other_file, other_scheduling}) {
    for (const absl::Status& status : {store_->CreateJob(job).status(), store_->FindRequest(job).status()}) {
      EXPECT_EQ(status.code(), StatusCode::kAlreadyExists);
      EXPECT_THAT(Text(status), AllOf(HasSubstr("r-1"), HasSubstr("j-a")));
    }
  }
  // What was asked for counts, not what has become of it.
  v1::Scheduling paused;
  paused.set_paused(true);
  ASSERT_TRUE(store_->SetScheduling(Owned("j-a"), paused).ok());
  EXPECT_EQ(*store_->CreateJob(Job("j-b", "r-1")), JobId("j-a"));
}

TEST_P(JobStoreTest, AnIdThatIsTakenIsAnError) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  EXPECT_EQ(store_->CreateJob(Job("j-a", "r-2")).status().code(), StatusCode::kAlreadyExists);
  EXPECT_THAT(Listed({}), ElementsAre("j-a"));
}

TEST_P(JobStoreTest, TextsAreKeptAsTheyAreAndNulIsRefused) {
  NewJob job = Job("j-a", "it's \"$1\" \\ \xC3\xA4\n%s");
  job.scheduling.set_user("'; DROP TABLE jobs; --");
  ASSERT_TRUE(store_->CreateJob(job).ok());
  EXPECT_EQ(Get("j-a").scheduling.user(), job.scheduling.user());
  EXPECT_THAT(Listed({.user = job.scheduling.user()}), ElementsAre("j-a"));
  const absl::Status nul = store_->CreateJob(Job("j-b", std::string("r\0x", 3))).status();
  EXPECT_EQ(nul.code(), StatusCode::kInvalidArgument);
  EXPECT_THAT(Text(nul), HasSubstr("r\\000x"));
}

TEST_P(JobStoreTest, ListsPagesNewestFirstWithoutFilesAndWarnings) {
  for (const char* id : {"j-b", "j-a", "j-c", "j-e", "j-d"}) ASSERT_TRUE(store_->CreateJob(Job(id, id)).ok());
  JobCommit commit = Commit("j-d", {Unit("j-d", 0, 0, 0)});
  commit.warnings = {"no light"};
  ASSERT_TRUE(CommitOne(commit).ok());
  const JobPage first = *store_->ListJobs({.limit = 2});
  ASSERT_THAT(first.jobs, SizeIs(2));
  EXPECT_EQ(first.jobs[0].id, JobId("j-d"));
  EXPECT_EQ(first.jobs[0].spec.scene().display_name(), "room.glb");
  EXPECT_EQ(first.jobs[0].spec.scene().dependencies_size(), 0);
  EXPECT_EQ(first.jobs[0].done.units, 1);
  EXPECT_THAT(first.jobs[0].warnings, IsEmpty());
  ASSERT_TRUE(first.next.has_value());
  // A job that is submitted meanwhile does not move the next page.
  ASSERT_TRUE(store_->CreateJob(Job("j-new", "new")).ok());
  const JobPage second = *store_->ListJobs({.limit = 2, .before = first.next});
  ASSERT_THAT(second.jobs, SizeIs(2));
  EXPECT_EQ(second.jobs[0].id, JobId("j-c"));
  const JobPage last = *store_->ListJobs({.limit = 2, .before = second.next});
  ASSERT_THAT(last.jobs, SizeIs(1));
  EXPECT_EQ(last.jobs[0].id, JobId("j-b"));
  EXPECT_FALSE(last.next.has_value());
}

TEST_P(JobStoreTest, ListsByStateAndUser) {
  for (const char* id : {"j-1", "j-2", "j-3", "j-4", "j-5", "j-6"}) {
    NewJob job = Job(id, id);
    job.scheduling.set_user(id[2] % 2 == 0 ? "ben" : "ann");
    ASSERT_TRUE(store_->CreateJob(job).ok());
  }
  ASSERT_TRUE(store_->EndJob(Owned("j-1"), {v1::JOB_STATE_DONE, ""}).ok());
  ASSERT_TRUE(store_->EndJob(Owned("j-2"), {v1::JOB_STATE_DONE, ""}).ok());
  ASSERT_TRUE(store_->EndJob(Owned("j-3"), {v1::JOB_STATE_FAILED, "broken"}).ok());
  EXPECT_THAT(Listed({.states = {v1::JOB_STATE_DONE}}), ElementsAre("j-2", "j-1"));
  EXPECT_THAT(Listed({.states = {v1::JOB_STATE_SUBMITTED}}), ElementsAre("j-6", "j-5", "j-4"));
  EXPECT_THAT(Listed({.user = "ann"}), ElementsAre("j-5", "j-3", "j-1"));
  EXPECT_THAT(Listed({.states = {v1::JOB_STATE_DONE, v1::JOB_STATE_FAILED}, .user = "ann"}),
              ElementsAre("j-3", "j-1"));
  EXPECT_THAT(Listed({.states = {v1::JOB_STATE_CANCELLED}}), IsEmpty());
  EXPECT_THAT(Listed({.user = "nobody"}), IsEmpty());
  const JobFilter all = {.limit = 2,
                         .states = {v1::JOB_STATE_SUBMITTED, v1::JOB_STATE_DONE, v1::JOB_STATE_FAILED}};
  JobPage page = *store_->ListJobs(all);
  std::string ids;
  while (true) {
    for (const JobRecord& job : page.jobs) ids += job.id.value().back();
    if (!page.next.has_value()) break;
    JobFilter next = all;
    next.before = page.next;
    page = *store_->ListJobs(next);
  }
  EXPECT_EQ(ids, "654321");
}

TEST_P(JobStoreTest, AClaimTakesTheUnfinishedJobsAndTheFormerOwnerIsRefused) {
  for (const char* id : {"j-b", "j-a", "j-ended"}) ASSERT_TRUE(store_->CreateJob(Job(id, id)).ok());
  JobCommit commit = Commit("j-b", {Unit("j-b", 0, 0, 0)});
  commit.warnings = {"no light"};
  ASSERT_TRUE(CommitOne(commit).ok());
  ASSERT_TRUE(store_->EndJob(Owned("j-ended"), {v1::JOB_STATE_CANCELLED, ""}).ok());
  const Owner second = {"coordinator:2", Epoch(2)};
  const ClaimedJobs claimed = *store_->ClaimUnfinishedJobs(second);
  ASSERT_THAT(claimed.jobs, SizeIs(2));
  EXPECT_THAT(claimed.damaged, IsEmpty());
  EXPECT_EQ(claimed.jobs[0].id, JobId("j-b"));
  EXPECT_EQ(claimed.jobs[0].owner, second);
  EXPECT_EQ(claimed.jobs[0].spec.scene().dependencies_size(), 1);
  EXPECT_THAT(claimed.jobs[0].warnings, ElementsAre("no light"));
  EXPECT_EQ(claimed.jobs[1].id, JobId("j-a"));

  const job::UnitKey key = {0, 0, 0, v1::UNIT_KIND_PASS};
  for (const absl::Status& status : {
           CommitOne(Commit("j-b", {Unit("j-b", 0, 1, 0)})),
           store_->RevokeUnits(Owned("j-b"), {key}),
           store_->RecordFrame(Owned("j-b"), 0, {}),
           store_->EndJob(Owned("j-b"), {v1::JOB_STATE_DONE, ""}),
           store_->SetScheduling(Owned("j-b"), {}),
           store_->ReopenFrames(JobId("j-b"), {"coordinator:1", Epoch(1)}, {}),
           store_->ClaimUnfinishedJobs({"coordinator:1", Epoch(1)}).status(),
       }) {
    EXPECT_EQ(status.code(), StatusCode::kAborted);
    EXPECT_THAT(Text(status), AllOf(HasSubstr("epoch 2"), HasSubstr("epoch 1")));
  }
  EXPECT_EQ(Get("j-b").done.units, 1);
  EXPECT_EQ(Get("j-b").state, v1::JOB_STATE_SUBMITTED);
  EXPECT_THAT(store_->ClaimUnfinishedJobs(second)->jobs, SizeIs(2));
  EXPECT_EQ(Get("j-ended").owner.epoch, Epoch(1));
}

TEST_P(JobStoreTest, AnAttemptOfAnotherEpochIsRefusedUnlessItIsRecovered) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(store_->ClaimUnfinishedJobs({"second", Epoch(2)}).ok());
  JobCommit commit = Commit("j-a", {Unit("j-a", 0, 0, 0)}, 2);
  const absl::Status stale = CommitOne(commit);
  EXPECT_EQ(stale.code(), StatusCode::kAborted);
  EXPECT_THAT(Text(stale),
              AllOf(HasSubstr("j-a frame 0 tile 0 pass 0"), HasSubstr("epoch 1"), HasSubstr("epoch 2")));
  commit.recovered = true;
  EXPECT_TRUE(CommitOne(commit).ok());
  UnitRecord future = Unit("j-a", 0, 1, 0);
  future.attempt = FirstAttempt(Epoch(3));
  commit.units = {future};
  EXPECT_TRUE(CommitOne(commit).ok());  // an older coordinator has adopted the job of a younger one
  EXPECT_THAT(Units("j-a"), SizeIs(2));
}

TEST_P(JobStoreTest, UnitsOfSeveralJobsEnterTogetherEachJobWhollyOrNot) {
  for (const char* id : {"j-a", "j-b", "j-c", "j-d"}) ASSERT_TRUE(store_->CreateJob(Job(id, id)).ok());
  ASSERT_TRUE(CommitOne(Commit("j-b", {Unit("j-b", 0, 0, 0)})).ok());
  ASSERT_TRUE(store_->EndJob(Owned("j-d"), {v1::JOB_STATE_CANCELLED, ""}).ok());
  UnitRecord again = Unit("j-b", 0, 0, 0);
  again.offset = 5;
  const std::vector<absl::Status> outcomes = *store_->CommitUnits({
      Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 1, 0, 0)}),
      Commit("j-b", {Unit("j-b", 0, 1, 0), again}),
      Commit("j-none", {Unit("j-none", 0, 0, 0)}),
      Commit("j-c", {Unit("j-c", 0, 0, 0)}),
      Commit("j-a", {Unit("j-a", 0, 2, 0), Unit("j-a", 0, 0, 0)}, 7),
      Commit("j-d", {Unit("j-d", 0, 0, 0)}),
  });
  ASSERT_THAT(outcomes, SizeIs(6));
  EXPECT_TRUE(outcomes[0].ok());
  EXPECT_EQ(outcomes[1].code(), StatusCode::kAlreadyExists);
  EXPECT_THAT(Text(outcomes[1]), HasSubstr("j-b frame 0 tile 0 pass 0"));
  EXPECT_EQ(outcomes[2].code(), StatusCode::kNotFound);
  EXPECT_TRUE(outcomes[3].ok());
  EXPECT_EQ(outcomes[4].code(), StatusCode::kAborted);
  EXPECT_EQ(outcomes[5].code(), StatusCode::kFailedPrecondition);
  Reopen();
  EXPECT_THAT(Units("j-a"), SizeIs(2));
  EXPECT_THAT(Units("j-b"), SizeIs(1));
  EXPECT_THAT(Units("j-c"), SizeIs(1));
  EXPECT_EQ(Get("j-a").done.units, 2);
  EXPECT_EQ(Get("j-a").done.samples, 200);
  EXPECT_EQ(Get("j-a").done.bad_samples, 2);
  EXPECT_EQ(Get("j-b").done.units, 1);
}

TEST_P(JobStoreTest, AUnitThatIsTwiceInOneCallIsRefused) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  EXPECT_EQ(CommitOne(Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 0, 0, 0)})).code(),
            StatusCode::kAlreadyExists);
  UnitRecord elsewhere = Unit("j-a", 0, 0, 0);
  elsewhere.offset = 5;
  const std::vector<absl::Status> outcomes = *store_->CommitUnits(
      {Commit("j-a", {Unit("j-a", 0, 0, 0)}), Commit("j-a", {Unit("j-a", 0, 1, 0), elsewhere}),
       Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 0, 2, 0)})});
  EXPECT_TRUE(outcomes[0].ok());
  EXPECT_EQ(outcomes[1].code(), StatusCode::kAlreadyExists);
  EXPECT_TRUE(outcomes[2].ok());  // as if it were a call of its own
  EXPECT_EQ(Get("j-a").done.units, 2);
}

TEST_P(JobStoreTest, ACommitCanBeRepeated) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  const JobCommit commit = Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 0, 1, 0)});
  ASSERT_TRUE(CommitOne(commit).ok());
  JobCommit longer = commit;
  longer.units.push_back(Unit("j-a", 0, 2, 0));
  EXPECT_TRUE(CommitOne(longer).ok());
  EXPECT_EQ(Get("j-a").done.units, 3);
  UnitRecord other_attempt = Unit("j-a", 0, 0, 0);
  other_attempt.attempt = job::Attempt(other_attempt.attempt.value() + 1);
  EXPECT_EQ(CommitOne(Commit("j-a", {other_attempt})).code(), StatusCode::kAlreadyExists);
}

TEST_P(JobStoreTest, UnitsComeInTheOrderOfTheFilmWithAllThatIsKnown) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  UnitRecord by_ben = Unit("j-a", 1, 0, 0);
  by_ben.worker = "ben:1";
  UnitRecord unnamed = Unit("j-a", 0, 1, 1);
  unnamed.worker = "";
  ASSERT_TRUE(CommitOne(Commit("j-a", {by_ben, unnamed, Unit("j-a", 0, 1, 0),
                                       Unit("j-a", 0, 0, 0, v1::UNIT_KIND_GEOMETRY), Unit("j-a", 0, 0, 0)}))
                  .ok());
  std::vector<std::string> names;
  for (const UnitRecord& unit : Units("j-a")) names.push_back(Describe(unit.unit) + " " + unit.worker);
  EXPECT_THAT(names, ElementsAre("j-a frame 0 tile 0 pass 0 host:17", "j-a frame 0 tile 0 geometry host:17",
                                 "j-a frame 0 tile 1 pass 0 host:17", "j-a frame 0 tile 1 pass 1 ",
                                 "j-a frame 1 tile 0 pass 0 ben:1"));
  const UnitRecord unit = Units("j-a", 1).at(0);
  EXPECT_EQ(unit.attempt, by_ben.attempt);
  EXPECT_EQ(unit.file, "film/x");
  EXPECT_EQ(unit.offset, uint64_t{1} << 40);
  EXPECT_EQ(unit.length, 77u);
  EXPECT_EQ(store_->ForEachUnit(JobId("j-none"), std::nullopt, [](const UnitRecord&) {}).code(),
            StatusCode::kNotFound);
}

TEST_P(JobStoreTest, TheFirstCommitBindsTheClassAndEachWarningIsKeptOnce) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  JobCommit first = Commit("j-a", {Unit("j-a", 0, 0, 0)});
  first.warnings = {"no light", "no camera", "no light"};
  JobCommit second = Commit("j-a", {Unit("j-a", 0, 1, 0)});
  second.numeric_class = "sse2";
  second.started = kStart + absl::Hours(1);
  second.warnings = {"big", "no light"};
  ASSERT_TRUE(CommitOne(first).ok());
  ASSERT_TRUE(CommitOne(second).ok());
  Reopen();
  const JobRecord job = Get("j-a");
  EXPECT_EQ(job.numeric_class, "avx2");
  EXPECT_EQ(job.started, kStart);
  EXPECT_THAT(job.warnings, ElementsAre("no light", "no camera", "big"));
}

TEST_P(JobStoreTest, WarningsAreLimitedAndTheRestIsCounted) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  JobCommit commit = Commit("j-a", {});
  for (int i = 0; i < job::kMaxJobWarnings + 3; ++i) commit.warnings.push_back(absl::StrCat("warning ", i));
  commit.warnings.push_back(commit.warnings.back());  // of a second unit
  commit.warnings.emplace_back("warning 0");
  ASSERT_TRUE(CommitOne(commit).ok());
  commit.warnings = {"one more", "warning 1"};
  ASSERT_TRUE(CommitOne(commit).ok());
  Reopen();
  const JobRecord job = Get("j-a");
  EXPECT_EQ(job.warnings.size(), size_t{job::kMaxJobWarnings});
  EXPECT_EQ(job.warnings.back(), absl::StrCat("warning ", job::kMaxJobWarnings - 1));
  EXPECT_EQ(job.warnings_left_out, 5);
}

TEST_P(JobStoreTest, RevokedUnitsCanBeCommittedAgain) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  const std::vector<UnitRecord> units = {Unit("j-a", 0, 0, 0), Unit("j-a", 0, 1, 0), Unit("j-a", 0, 2, 0)};
  ASSERT_TRUE(CommitOne(Commit("j-a", units)).ok());
  const std::vector<job::UnitKey> lost = {
      units[1].unit.key, units[2].unit.key, {0, 3, 0, v1::UNIT_KIND_PASS}, {9, 0, 0, v1::UNIT_KIND_PASS}};
  ASSERT_TRUE(store_->RevokeUnits(Owned("j-a"), lost).ok());
  Reopen();
  EXPECT_EQ(Get("j-a").done.units, 1);
  EXPECT_EQ(Get("j-a").done.samples, 100);
  EXPECT_EQ(Get("j-a").done.bad_samples, 1);
  ASSERT_TRUE(CommitOne(Commit("j-a", {units[1], units[2]})).ok());
  EXPECT_EQ(Get("j-a").done.samples, 300);
  EXPECT_EQ(store_->RevokeUnits(Owned("j-x"), lost).code(), StatusCode::kNotFound);
}

TEST_P(JobStoreTest, AnEndedJobStaysAsItIs) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(store_->EndJob(Owned("j-a"), {v1::JOB_STATE_FAILED, "it's \"broken\""}).ok());
  ASSERT_TRUE(store_->EndJob(Owned("j-a"), {v1::JOB_STATE_DONE, ""}).ok());
  EXPECT_EQ(store_->SetScheduling(Owned("j-a"), {}).code(), StatusCode::kFailedPrecondition);
  EXPECT_EQ(store_->RecordFrame(Owned("j-a"), 0, {}).code(), StatusCode::kFailedPrecondition);
  Reopen();
  EXPECT_EQ(Get("j-a").state, v1::JOB_STATE_FAILED);
  EXPECT_EQ(Get("j-a").error, "it's \"broken\"");
  EXPECT_THAT(store_->ClaimUnfinishedJobs({"next", Epoch(2)})->jobs, IsEmpty());
  EXPECT_EQ(store_->EndJob(Owned("j-x"), {v1::JOB_STATE_DONE, ""}).code(), StatusCode::kNotFound);
}

TEST_P(JobStoreTest, SchedulingCanBeChanged) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  v1::Scheduling scheduling;
  scheduling.set_priority(-7);
  scheduling.set_user("ben");
  scheduling.set_paused(true);
  ASSERT_TRUE(store_->SetScheduling(Owned("j-a"), scheduling).ok());
  Reopen();
  EXPECT_EQ(Get("j-a").scheduling.SerializeAsString(), scheduling.SerializeAsString());
  EXPECT_THAT(Listed({.user = "ben"}), ElementsAre("j-a"));
  EXPECT_EQ(store_->SetScheduling(Owned("j-x"), scheduling).code(), StatusCode::kNotFound);
}

TEST_P(JobStoreTest, AJobGetsItsPlan) {
  NewJob job = Job("j-a", "r-1");
  job.spec.clear_tile_size();
  job.spec.clear_pass_samples();
  ASSERT_TRUE(store_->CreateJob(job).ok());
  v1::JobSpec planned = Get("j-a").spec;
  *planned.mutable_plan() = MadeUpPlan(16, 6);
  planned.mutable_plan()->set_numeric_class("avx2");
  planned.set_tile_size(16);
  planned.set_pass_samples(6);
  EXPECT_EQ(store_->SetPlan(Owned("j-a", 2), planned).code(), StatusCode::kAborted);
  EXPECT_FALSE(Get("j-a").spec.has_plan());
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(store_->SetPlan(Owned("j-a"), planned).ok());  // it can be repeated
  Reopen();
  EXPECT_EQ(Get("j-a").spec.SerializeAsString(), planned.SerializeAsString());
  job.id = JobId("j-b");
  EXPECT_EQ(*store_->CreateJob(job), JobId("j-a")) << "a repeated request finds the job";
  EXPECT_EQ(store_->SetPlan(Owned("j-x"), planned).code(), StatusCode::kNotFound);
  ASSERT_TRUE(store_->EndJob(Owned("j-a"), {v1::JOB_STATE_CANCELLED, ""}).ok());
  EXPECT_EQ(store_->SetPlan(Owned("j-a"), planned).code(), StatusCode::kFailedPrecondition);
  EXPECT_TRUE(Get("j-a").spec.has_plan()) << "explain shows it";
  ASSERT_TRUE(store_->DeleteJob(JobId("j-a")).ok());
  EXPECT_EQ(store_->GetJob(JobId("j-a")).status().code(), StatusCode::kNotFound);
}

TEST_P(JobStoreTest, AnEndedJobIsReopenedForAnotherOwner) {
  ASSERT_TRUE(store_->CreateJob(Job("j-a", "r-1")).ok());
  ASSERT_TRUE(
      CommitOne(Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 1, 0, 0), Unit("j-a", 2, 0, 0)})).ok());
  ASSERT_TRUE(store_->RecordFrame(Owned("j-a"), 0, {}).ok());
  ASSERT_TRUE(store_->RecordFrame(Owned("j-a"), 1, {}).ok());
  ASSERT_TRUE(store_->EndJob(Owned("j-a"), {v1::JOB_STATE_FAILED, "broken"}).ok());
  v1::JobSpec spec = Get("j-a").spec;
  spec.set_samples_per_pixel(64);
  v1::Scheduling scheduling = Get("j-a").scheduling;
  scheduling.mutable_gaps()->add_skipped()->set_first(2);
  const Reopening reopening = {.spec = spec, .scheduling = scheduling, .frames = {1}};
  EXPECT_EQ(store_->ReopenFrames(JobId("j-a"), {"older", Epoch(0)}, reopening).code(), StatusCode::kAborted);
  const Owner owner = {"second", Epoch(2)};
  ASSERT_TRUE(store_->ReopenFrames(JobId("j-a"), owner, reopening).ok());
  Reopen();
  const JobRecord job = Get("j-a");
  EXPECT_EQ(job.state, v1::JOB_STATE_SUBMITTED);
  EXPECT_EQ(job.error, "");
  EXPECT_EQ(job.owner, owner);
  EXPECT_EQ(job.spec.SerializeAsString(), spec.SerializeAsString());
  EXPECT_EQ(job.scheduling.SerializeAsString(), scheduling.SerializeAsString());
  EXPECT_EQ(job.numeric_class, "avx2");
  EXPECT_EQ(job.done.frames, 1);
  EXPECT_EQ(job.done.units, 1);  // frame 2 had not been recorded when the job ended
  EXPECT_EQ(job.done.samples, 100);
  EXPECT_THAT(*store_->FinishedFrames(JobId("j-a")), ElementsAre(0));
  EXPECT_THAT(Units("j-a"), IsEmpty());
  // What the log holds is committed again, before and after the old rows are gone.
  JobCommit kept = Commit("j-a", {Unit("j-a", 1, 0, 0)}, 2);
  kept.recovered = true;
  EXPECT_TRUE(CommitOne(kept).ok());
  EXPECT_EQ(*store_->PurgeUnits(100), 0);
  EXPECT_THAT(Units("j-a"), SizeIs(1));
  EXPECT_EQ(Get("j-a").done.units, 2);
  EXPECT_EQ(*store_->CreateJob(Job("j-b", "r-1")), JobId("j-a"));  // still the same request
}

TEST_P(JobStoreTest, UsageCountsEachUnitAndFrameOnceAndOutlivesTheJob) {
  const absl::Time day = absl::FromCivil(absl::CivilHour(2026, 11, 3, 12), absl::UTCTimeZone());
  const auto usage = [&](int first, int last, const std::string& user = "") {
    return *store_->Usage(
        {.since = day + absl::Hours(24 * first), .until = day + absl::Hours(24 * last), .user = user});
  };
  NewJob job = Job("j-a", "r-1");
  job.scheduling.set_user("ann");
  ASSERT_TRUE(store_->CreateJob(job).ok());
  JobCommit commit = Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 0, 1, 0), Unit("j-a", 0, 2, 0)});
  commit.units[0].cost = UnitCost{day, 1.5};
  commit.units[1].cost = UnitCost{day + absl::Hours(24), 2};
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(CommitOne(commit).ok()) << "a repeated call";
  v1::FrameReport report;
  report.set_core_seconds(8);
  report.set_finished_unix_ms(absl::ToUnixMillis(day));
  report.mutable_times()->set_filter_seconds(3);
  report.mutable_times()->set_write_seconds(1);
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(store_->RecordFrame(Owned("j-a"), 0, report).ok());
  Reopen();
  ASSERT_THAT(usage(0, 1), SizeIs(1));
  EXPECT_EQ(usage(0, 1)[0].job, JobId("j-a"));
  EXPECT_EQ(usage(0, 1)[0].user, "ann");
  EXPECT_EQ(usage(0, 1)[0].work.units, 1);
  EXPECT_EQ(usage(0, 1)[0].work.render_seconds, 1.5);
  EXPECT_EQ(usage(0, 1)[0].work.frames, 1);
  EXPECT_EQ(usage(0, 1)[0].work.finish_seconds, 8);
  EXPECT_EQ(usage(0, 2)[0].work.render_seconds, 3.5);
  EXPECT_EQ(usage(1, 2)[0].work.frames, 0);
  EXPECT_THAT(usage(2, 9), IsEmpty());
  EXPECT_THAT(usage(0, 9, "ben"), IsEmpty());
  ASSERT_TRUE(store_->EndJob(Owned("j-a"), {v1::JOB_STATE_DONE, ""}).ok());
  ASSERT_TRUE(store_->DeleteJob(JobId("j-a")).ok());
  EXPECT_EQ(usage(0, 2, "ann")[0].work.units, 2);
}

TEST_P(JobStoreTest, ADeletedJobIsGoneWithAllItsRows) {
  for (const char* id : {"j-a", "j-b"}) {
    ASSERT_TRUE(store_->CreateJob(Job(id, id)).ok());
    JobCommit commit = Commit(id, {Unit(id, 0, 0, 0), Unit(id, 1, 0, 0)});
    commit.warnings = {"no light"};
    ASSERT_TRUE(CommitOne(commit).ok());
  }
  ASSERT_TRUE(store_->RecordFrame(Owned("j-a"), 0, {}).ok());
  EXPECT_EQ(store_->DeleteJob(JobId("j-a")).code(), StatusCode::kFailedPrecondition);
  ASSERT_TRUE(store_->EndJob(Owned("j-a"), {v1::JOB_STATE_DONE, ""}).ok());
  ASSERT_TRUE(store_->DeleteJob(JobId("j-a")).ok());
  EXPECT_EQ(store_->DeleteJob(JobId("j-a")).code(), StatusCode::kNotFound);
  EXPECT_EQ(store_->GetJob(JobId("j-a")).status().code(), StatusCode::kNotFound);
  EXPECT_EQ(*store_->PurgeUnits(100), 0);
  EXPECT_THAT(Listed({}), ElementsAre("j-b"));
  EXPECT_THAT(Units("j-b"), SizeIs(2));
  // Nothing of the old job is found in a new one with its id.
  ASSERT_EQ(*store_->CreateJob(Job("j-a", "j-a")), JobId("j-a"));
  EXPECT_THAT(Units("j-a"), IsEmpty());
  EXPECT_THAT(*store_->FinishedFrames(JobId("j-a")), IsEmpty());
  EXPECT_THAT(Get("j-a").warnings, IsEmpty());
}

TEST_P(JobStoreTest, BlockedWorkersStayBlocked) {
  ASSERT_TRUE(store_->BlockWorker("w2", "wrong pixels").ok());
  ASSERT_TRUE(store_->BlockWorker("W10", "").ok());
  ASSERT_TRUE(store_->BlockWorker("w2", "wrong pixels again").ok());
  Reopen();
  EXPECT_THAT(*store_->BlockedWorkers(),
              ElementsAre(BlockedWorker{"W10", ""}, BlockedWorker{"w2", "wrong pixels again"}));
  ASSERT_TRUE(store_->ReadmitWorker("w2").ok());
  const absl::Status unknown = store_->ReadmitWorker("w2");
  EXPECT_EQ(unknown.code(), StatusCode::kNotFound);
  EXPECT_THAT(Text(unknown), HasSubstr("'w2'"));
  EXPECT_THAT(*store_->BlockedWorkers(), SizeIs(1));
}

}  // namespace
}  // namespace lumifold::ledger
