#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "absl/time/clock.h"
#include "server/film/unit_log.h"
#include "server/frame_finisher.h"
#include "server/ledger/sqlite_job_store.h"
#include "server/scheduler/tile_grid.h"
#include "tests/support/random_unit.h"
#include "tests/support/temp_folder.h"

namespace lumifold::server {
namespace {

using scheduler::JobId;
using ::testing::HasSubstr;

const JobId kJob("j-1");

/// A data folder with one merged frame, as a coordinator leaves it.
class ChildProcessFinisherTest : public ::testing::Test {
 protected:
  ChildProcessFinisherTest() {
    EXPECT_TRUE(folder_.Claim().ok());
    store_ = *ledger::OpenSqliteJobStore(folder_.LedgerPath());
    ledger::NewJob job{.id = kJob, .request_id = "r", .spec = {}, .submitted = absl::Now()};
    job.spec.set_width(20);
    job.spec.set_height(12);
    job.spec.set_tile_size(8);
    job.spec.set_samples_per_pixel(10);
    job.spec.set_pass_samples(4);
    job.spec.set_frame_count(1);
    job.spec.mutable_filter()->set_method("default");
    EXPECT_TRUE(store_->CreateJob(job).ok());
    MergeAll(job.spec);
  }

  void MergeAll(const v1::JobSpec& spec) {
    EXPECT_TRUE(MakeFolder(folder_.FilmPath(kJob)).ok());
    const std::string name = DataFolder::UnitLogName(kJob, 0);
    absl::StatusOr<film::UnitLog> log = film::UnitLog::Open(folder_.PathOf(name), 0);
    const scheduler::FrameUnits units(spec);
    std::vector<ledger::UnitRecord> records;
    for (int64_t number = units.count() - 1; number >= 0; --number) {
      const scheduler::UnitKey key = units.KeyOf(0, number);
      const film::StoredUnit unit{{kJob, key},
                                  scheduler::Attempt(1),
                                  {},
                                  RandomUnit(key, units.tiles().RectOf(key.tile), units.SamplesOf(key), 1)};
      const film::RecordPlace place = *log->Append(unit);
      records.push_back({.unit = unit.unit, .file = name, .offset = place.offset, .length = place.length});
    }
    EXPECT_TRUE(store_->CommitUnits(records, {}).ok());
  }

  std::string Result() const {
    std::ifstream file(folder_.ResultPath(kJob, 0), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  std::unique_ptr<FrameFinisher> Child(ChildProcessOptions options = {}) const {
    if (options.program == ChildProcessOptions().program) options.program = LUMIFOLD_SERVER_PROGRAM;
    return MakeChildProcessFinisher(folder_, options);
  }

  TempFolder temp_;
  const DataFolder folder_{temp_.PathOf("data")};
  std::unique_ptr<ledger::JobStore> store_;
};

TEST_F(ChildProcessFinisherTest, WritesTheSameFileAsTheFinisherWithin) {
  ASSERT_TRUE(
      MakeInProcessFinisher(folder_, store_.get(), 2, [] { return absl::Now(); })->Finish(kJob, 0).ok());
  const std::string expected = Result();
  ASSERT_FALSE(expected.empty());
  ASSERT_TRUE(RemoveAll(folder_.ResultsPath(kJob)).ok());
  const absl::StatusOr<v1::StageTimes> times = Child({.threads = 1})->Finish(kJob, 0);
  ASSERT_TRUE(times.ok()) << times.status();
  EXPECT_GT(times->filter_seconds(), 0.0);
  EXPECT_EQ(Result(), expected);
}

TEST_F(ChildProcessFinisherTest, TellsWhatTheChildTells) {
  const absl::Status status = Child()->Finish(JobId("j-none"), 0).status();
  EXPECT_EQ(status, absl::NotFoundError("no job j-none"));
}

TEST_F(ChildProcessFinisherTest, ADamagedRecordIsNamed) {
  const std::string path = folder_.PathOf(DataFolder::UnitLogName(kJob, 0));
  std::fstream(path, std::ios::binary | std::ios::in | std::ios::out).seekp(5000).put('!');
  const absl::Status status = Child()->Finish(kJob, 0).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), HasSubstr(path));
  EXPECT_EQ(Result(), "");
}

TEST_F(ChildProcessFinisherTest, AChildWithoutMemoryOrProgramIsAnErrorAndNoCrash) {
  EXPECT_FALSE(Child({.memory_limit_bytes = 1 << 20})->Finish(kJob, 0).ok());
  EXPECT_THAT(std::string(Child({.program = "/none/such"})->Finish(kJob, 0).status().message()),
              HasSubstr("/none/such"));
}

TEST_F(ChildProcessFinisherTest, AfterCancelNothingStarts) {
  const std::unique_ptr<FrameFinisher> finisher = Child();
  finisher->Cancel();
  EXPECT_EQ(finisher->Finish(kJob, 0).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(Result(), "");
}

}  // namespace
}  // namespace lumifold::server
