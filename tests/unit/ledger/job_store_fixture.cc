#include "tests/unit/ledger/job_store_fixture.h"

#include <utility>

namespace lumifold::ledger {
namespace {

using job::JobId;

}  // namespace

NewJob Job(const std::string& id, const std::string& request_id) {
  NewJob job;
  job.id = JobId(id);
  job.request_id = request_id;
  job.submitted = kStart;
  job.owner = {"coordinator:1", Epoch(1)};
  job.spec.set_width(640);
  job.spec.mutable_scene()->set_display_name("room.glb");
  job.spec.mutable_scene()->add_dependencies()->set_uri("wood.png");
  job.scheduling.set_user("ann");
  return job;
}

UnitRecord Unit(const std::string& job, int32_t frame, int32_t tile, int32_t pass, v1::UnitKind kind) {
  return {.unit = {JobId(job), {frame, tile, pass, kind}},
          .attempt = job::Attempt(FirstAttempt(Epoch(1)).value() + 5),
          .worker = "host:17",
          .file = "film/x",
          .offset = uint64_t{1} << 40,
          .length = 77,
          .samples = 100,
          .bad_samples = 1};
}

JobCommit Commit(const std::string& job, std::vector<UnitRecord> units, int64_t epoch) {
  JobCommit commit;
  commit.job = Owned(job, epoch);
  commit.numeric_class = "avx2";
  commit.started = kStart;
  commit.units = std::move(units);
  return commit;
}

void JobStoreTest::SetUp() {
  std::string why_not;
  database_ = GetParam().make(&why_not);
  if (database_ == nullptr && why_not.find("not installed") != std::string::npos) GTEST_SKIP() << why_not;
  ASSERT_NE(database_, nullptr) << why_not;
  Reopen();
}

void JobStoreTest::Reopen() {
  store_.reset();
  absl::StatusOr<std::unique_ptr<JobStore>> store = database_->Open();
  ASSERT_TRUE(store.ok()) << store.status();
  store_ = *std::move(store);
}

absl::Status JobStoreTest::CommitOne(const JobCommit& commit) {
  const absl::StatusOr<std::vector<absl::Status>> outcomes = store_->CommitUnits({commit});
  if (!outcomes.ok()) return outcomes.status();
  EXPECT_EQ(outcomes->size(), 1u);
  return outcomes->front();
}

std::vector<UnitRecord> JobStoreTest::Units(const std::string& job, std::optional<int32_t> frame) {
  std::vector<UnitRecord> units;
  const absl::Status status =
      store_->ForEachUnit(JobId(job), frame, [&](const UnitRecord& unit) { units.push_back(unit); });
  EXPECT_TRUE(status.ok()) << status;
  return units;
}

JobRecord JobStoreTest::Get(const std::string& job) {
  absl::StatusOr<JobRecord> record = store_->GetJob(JobId(job));
  EXPECT_TRUE(record.ok()) << record.status();
  return record.ok() ? *std::move(record) : JobRecord();
}

std::vector<std::string> JobStoreTest::Listed(const JobFilter& filter) {
  const absl::StatusOr<JobPage> page = store_->ListJobs(filter);
  EXPECT_TRUE(page.ok()) << page.status();
  std::vector<std::string> ids;
  if (!page.ok()) return ids;
  for (const JobRecord& job : page->jobs) ids.push_back(job.id.value());
  return ids;
}

}  // namespace lumifold::ledger
