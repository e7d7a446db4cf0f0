// Speed of the ledger in SQLite: pages of a long list, the restart of a coordinator, commits.
//   ledger-bench
// Limits: a page of 100 out of 100,000 jobs < 50 ms; a restart with 100,000 committed units < 2 s.
#include <benchmark/benchmark.h>

#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "server/ledger/sqlite_job_store.h"
#include "tests/support/temp_folder.h"

namespace lumifold::ledger {
namespace {

constexpr int kJobs = 100'000;
constexpr int kUnits = 100'000;
constexpr int kUsers = 20;
constexpr int kFrames = 10;

const Owner kOwner = {"bench", Epoch(1)};

NewJob Job(int number) {
  NewJob job;
  job.id = job::JobId(absl::StrCat("j-", number));
  job.request_id = absl::StrCat("request-", number);
  job.spec.set_width(1920);
  job.spec.set_height(1080);
  job.spec.mutable_scene()->set_display_name("room.glb");
  for (int i = 0; i < 20; ++i) {
    v1::AssetRef* file = job.spec.mutable_scene()->add_dependencies();
    file->set_uri(absl::StrCat("textures/", i, ".png"));
    file->set_sha256(std::string(64, 'a'));
  }
  job.scheduling.set_user(absl::StrCat("user-", number % kUsers));
  job.submitted = absl::FromUnixMillis(1'700'000'000'000 + number);
  job.owner = kOwner;
  return job;
}

UnitRecord Unit(const job::JobId& job, int number) {
  UnitRecord unit;
  unit.unit = {job, {number % kFrames, number / kFrames, 0, v1::UNIT_KIND_PASS}};
  unit.attempt = job::Attempt(FirstAttempt(kOwner.epoch).value() + number);
  unit.worker = absl::StrCat("host-", number % 100, ":4711");
  unit.file = absl::StrCat("film/", job.value(), "/frame-000", number % kFrames, ".units");
  unit.offset = static_cast<uint64_t>(number) * 50'000;
  unit.length = 50'000;
  unit.samples = 4096;
  return unit;
}

std::unique_ptr<JobStore> Open(const TempFolder& folder) {
  return *OpenSqliteJobStore(folder.PathOf("ledger.db"));
}

/// A ledger with 100,000 jobs: every tenth failed, 100 are active, the others are done. A call a job would
/// sync the disk each time, so the jobs are made outside of the measured loop, once.
JobStore& StoreWithJobs() {
  static const TempFolder folder;
  static const std::unique_ptr<JobStore> store = [] {
    std::unique_ptr<JobStore> made = Open(folder);
    for (int i = 0; i < kJobs; ++i) {
      const NewJob job = Job(i);
      LUMIFOLD_CHECK(made->CreateJob(job).ok());
      if (i % 1000 == 0) continue;
      const v1::JobState state = i % 10 == 1 ? v1::JOB_STATE_FAILED : v1::JOB_STATE_DONE;
      LUMIFOLD_CHECK(made->EndJob({job.id, kOwner.epoch}, {state, ""}).ok());
    }
    return made;
  }();
  return *store;
}

void ListPage(benchmark::State& state, const JobFilter& filter) {
  JobStore& store = StoreWithJobs();
  for (auto _ : state) {
    const absl::StatusOr<JobPage> page = store.ListJobs(filter);
    LUMIFOLD_CHECK(page.ok() && page->jobs.size() == static_cast<size_t>(filter.limit));
  }
}
BENCHMARK_CAPTURE(ListPage, First, JobFilter{.limit = 100})->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ListPage, Thousand, JobFilter{.limit = 1000})->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ListPage, InTheMiddle, JobFilter{.limit = 100, .before = kJobs / 2})
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ListPage, OfStates,
                  JobFilter{.limit = 100, .states = {v1::JOB_STATE_SUBMITTED, v1::JOB_STATE_FAILED}})
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ListPage, ActiveOnly, JobFilter{.limit = 100, .states = {v1::JOB_STATE_SUBMITTED}})
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(ListPage, OfUserAndState,
                  JobFilter{.limit = 100, .states = {v1::JOB_STATE_DONE}, .user = "user-7"})
    ->Unit(benchmark::kMillisecond);

/// All that a coordinator asks of the ledger when it starts, with one job of 100,000 units.
void Restart(benchmark::State& state) {
  const TempFolder folder;
  const NewJob job = Job(0);
  {
    const std::unique_ptr<JobStore> store = Open(folder);
    LUMIFOLD_CHECK(store->CreateJob(job).ok());
    JobCommit commit;
    commit.job = {job.id, kOwner.epoch};
    for (int i = 0; i < kUnits; ++i) commit.units.push_back(Unit(job.id, i));
    LUMIFOLD_CHECK(store->CommitUnits({commit})->front().ok());
  }
  for (auto _ : state) {
    const std::unique_ptr<JobStore> store = Open(folder);
    const Owner owner = {"next", *store->NewEpoch(kOwner.epoch)};
    LUMIFOLD_CHECK(store->ClaimUnfinishedJobs(owner)->jobs.size() == 1);
    int64_t units = 0;
    LUMIFOLD_CHECK(store->FinishedFrames(job.id).ok());
    LUMIFOLD_CHECK(store->ForEachUnit(job.id, std::nullopt, [&units](const UnitRecord&) { ++units; }).ok());
    LUMIFOLD_CHECK(units == kUnits);
  }
}
BENCHMARK(Restart)->Unit(benchmark::kMillisecond);

/// Commits of `units` units over `jobs` jobs; the disk's sync is in it.
void CommitGroup(benchmark::State& state) {
  const TempFolder folder;
  const std::unique_ptr<JobStore> store = Open(folder);
  const auto jobs = static_cast<int>(state.range(0));
  const auto units = static_cast<int>(state.range(1));
  for (int i = 0; i < jobs; ++i) LUMIFOLD_CHECK(store->CreateJob(Job(i)).ok());
  int next = 0;
  for (auto _ : state) {
    std::vector<JobCommit> commits(static_cast<size_t>(jobs));
    for (int i = 0; i < jobs; ++i) {
      JobCommit& commit = commits[static_cast<size_t>(i)];
      commit.job = {job::JobId(absl::StrCat("j-", i)), kOwner.epoch};
      commit.numeric_class = "avx2";
      for (int k = 0; k < units / jobs; ++k) commit.units.push_back(Unit(commit.job.job, next + k));
    }
    next += units / jobs;
    const std::vector<absl::Status> outcomes = *store->CommitUnits(commits);
    for (const absl::Status& status : outcomes) LUMIFOLD_CHECK(status.ok());
  }
  state.SetItemsProcessed(state.iterations() * units);
}
BENCHMARK(CommitGroup)
    ->Args({1, 1})
    ->Args({1, 256})
    ->Args({16, 256})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace lumifold::ledger

BENCHMARK_MAIN();
