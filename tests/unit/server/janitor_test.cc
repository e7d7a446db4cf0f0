// What goes from a data folder, and when.
#include "server/storage/janitor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "server/job/job_spec.h"
#include "server/ledger/sqlite_job_store.h"
#include "server/storage/manifest.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/server/faulty_files.h"
#include "tests/unit/server/store_wrapper.h"

namespace lumifold::server {
namespace {

using job::JobId;
using ::testing::AllOf;
using ::testing::HasSubstr;

namespace fs = std::filesystem;

const ledger::Owner kJanitorsOwner{"owner", ledger::Epoch(1)};

/// A ledger one of whose rows nobody can read, if told so.
class DamagedStore final : public StoreWrapper {
 public:
  using StoreWrapper::StoreWrapper;
  absl::StatusOr<ledger::JobPage> ListJobs(const ledger::JobFilter& filter) override {
    absl::StatusOr<ledger::JobPage> page = StoreWrapper::ListJobs(filter);
    if (is_damaged) page->damaged.push_back({JobId("j-damaged"), absl::InternalError("damaged")});
    return page;
  }
  bool is_damaged = false;

 private:
  absl::Status Before(const std::string&) override { return absl::OkStatus(); }
};

class JanitorTest : public ::testing::Test {
 protected:
  JanitorTest() : store_(*ledger::OpenSqliteJobStore(folder_.PathOf("ledger.db"))) {
    EXPECT_TRUE(data_.MakeFolders().ok());
    limits_.free_bytes = 0;
  }
  ~JanitorTest() override {
    thread_.Stop();
    deleter_.Stop();
  }

  void Make() {
    janitor_.emplace(JanitorOptions{.limits = limits_,
                                    .now = [this] { return now_; },
                                    .wall_now = [this] { return absl::Now() + age_; },
                                    .disk = [this] { return disk_; },
                                    .log = std::make_shared<spdlog::logger>("none")},
                     data_, &store_, &assets_, &thread_, &deleter_);
    janitor_->Start();
    Settle();
  }
  /// Until nothing is left to do: a removal goes from one thread to the other and back.
  void Settle() {
    for (int i = 0; i < 30; ++i) {
      thread_.Drain();
      deleter_.Drain();
    }
  }
  void Write(const std::string& path, size_t bytes) {
    fs::create_directories(fs::path(path).parent_path());
    std::ofstream(path) << std::string(bytes, 'x');
  }
  /// A job that is rendered in part: a log of `film` bytes of frame 0, a result of `result` bytes.
  JobId Begin(const std::string& name, size_t film, size_t result, const std::string& asset = "a") {
    ledger::NewJob job;
    job.id = JobId(name);
    job.request_id = name;
    job.submitted = absl::Now();
    job.owner = kJanitorsOwner;
    job.spec.mutable_scene()->mutable_file()->set_sha256(std::string(64, asset[0]));
    job.spec.set_width(8);
    job.spec.set_height(8);
    job.spec.set_frame_count(1);
    job.spec.set_samples_per_pixel(1);
    job.spec = *job::NormaliseJobSpec(job.spec);
    EXPECT_TRUE(store_.CreateJob(job).ok());
    EXPECT_TRUE(WriteManifest(data_, ManifestOf(job)).ok());
    if (film > 0) Write(data_.PathOf(data_.UnitLogName(job.id, 0)), film);
    Write(data_.ResultPath(job.id, 0), result);
    return job.id;
  }
  void End(const JobId& job) {
    EXPECT_TRUE(store_.EndJob({job, kJanitorsOwner.epoch}, {v1::JOB_STATE_FAILED, "why"}).ok());
    janitor_->JobEnded(job, v1::JOB_STATE_FAILED, "why");
    Settle();
  }
  bool HasFilm(const JobId& job) const { return fs::exists(data_.FilmPath(job)); }
  bool HasResults(const JobId& job) const { return fs::exists(data_.ResultsPath(job)); }
  bool HasRow(const JobId& job) { return store_.GetJob(job).ok(); }
  bool IsGone(const JobId& job) {
    return !HasRow(job) && !HasFilm(job) && !HasResults(job) && !data_.IsBeingDeleted(job);
  }

  TempFolder folder_;
  FaultyFiles files_;
  const DataFolder data_{folder_.path(), &files_};
  DamagedStore store_;
  AssetStore assets_{data_.AssetsPath(), data_.IncomingPath()};
  threads::TaskThread thread_{threads::TaskThread::Priority::kNormal};
  threads::TaskThread deleter_{threads::TaskThread::Priority::kNormal};
  RetentionLimits limits_;
  absl::Time now_ = absl::FromUnixSeconds(1000);
  absl::Duration age_ = absl::ZeroDuration();
  DiskSpace disk_{.free_bytes = 1 << 20, .kept_bytes = 0};
  std::optional<Janitor> janitor_;
};

TEST_F(JanitorTest, AnEndedJobKeepsItsFilmWithinTheLimitAndItsResultsBeyond) {
  const JobId job = Begin("j-1", 100, 10), empty = Begin("j-2", 0, 10);
  limits_.film_bytes = 100;
  Make();
  End(job);
  const v1::JobManifest manifest = *ReadManifest(data_.EndedManifestPath(job));
  EXPECT_EQ(manifest.end_state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(manifest.error(), "why");
  EXPECT_TRUE(HasFilm(job)) << "exactly the limit";
  End(empty);
  EXPECT_FALSE(HasFilm(empty)) << "a folder without a film";
  const JobId later = Begin("j-3", 1, 10);
  End(later);
  EXPECT_FALSE(HasFilm(job)) << "the first that ended";
  EXPECT_TRUE(HasFilm(later));
  EXPECT_TRUE(HasResults(job));
  EXPECT_TRUE(HasRow(job));
}

TEST_F(JanitorTest, AFinishedFrameGoesByItselfAndOneWithoutALogIsNone) {
  const JobId job = Begin("j-1", 100, 10);
  Write(data_.PathOf(data_.UnitLogName(job, 1)), 50);
  limits_.film_bytes = 0;
  Make();
  EXPECT_TRUE(fs::exists(data_.PathOf(data_.UnitLogName(job, 0)))) << "it is not finished";
  janitor_->FrameFinished(job, 7);
  janitor_->FrameFinished(job, 0);
  Settle();
  EXPECT_FALSE(fs::exists(data_.PathOf(data_.UnitLogName(job, 0))));
  EXPECT_TRUE(fs::exists(data_.PathOf(data_.UnitLogName(job, 1))));
}

TEST_F(JanitorTest, AJobGoesAtItsAgeUnlessAnotherWaitsForIt) {
  limits_.keep_results = absl::Hours(1);
  const JobId job = Begin("j-1", 10, 10), needed = Begin("j-2", 10, 10);
  Make();
  End(job);
  End(needed);
  janitor_->SetNeeded({needed});
  age_ = absl::Minutes(59);
  janitor_->Poke();
  Settle();
  EXPECT_TRUE(HasRow(job));
  age_ = absl::Minutes(61);
  janitor_->Poke();
  Settle();
  EXPECT_TRUE(IsGone(job));
  EXPECT_TRUE(HasRow(needed) && HasFilm(needed) && HasResults(needed));
  janitor_->SetNeeded({});
  janitor_->Poke();
  Settle();
  EXPECT_TRUE(IsGone(needed));
}

TEST_F(JanitorTest, AJobCountsFromItsEndAlsoAfterARestart) {
  limits_.keep_results = absl::Hours(1);
  const JobId job = Begin("j-1", 10, 10), young = Begin("j-2", 10, 10);
  Make();
  End(job);
  End(young);
  fs::last_write_time(data_.EndedManifestPath(job), fs::file_time_type::clock::now() - std::chrono::hours(2));
  janitor_.reset();
  Make();
  EXPECT_TRUE(IsGone(job));
  EXPECT_TRUE(HasRow(young));
}

TEST_F(JanitorTest, ADeletionIsOfAJobThatHasEnded) {
  const JobId job = Begin("j-1", 10, 10), running = Begin("j-2", 10, 10);
  Make();
  End(job);
  EXPECT_TRUE(absl::IsNotFound(janitor_->Delete(JobId("j-none"))));
  EXPECT_TRUE(absl::IsFailedPrecondition(janitor_->Delete(running)));
  Settle();
  EXPECT_FALSE(data_.IsBeingDeleted(running) || data_.IsBeingDeleted(JobId("j-none")));
  EXPECT_TRUE(HasRow(running) && HasFilm(running) && HasResults(running));
  EXPECT_TRUE(janitor_->Delete(job).ok());
  EXPECT_FALSE(HasRow(job)) << "at once";
  Settle();
  EXPECT_TRUE(IsGone(job));
  files_.Fail(EIO, "/deleted/");
  End(running);
  EXPECT_TRUE(absl::IsUnavailable(janitor_->Delete(running)));
  EXPECT_TRUE(HasRow(running)) << "a deletion that could not be recorded is none";
}

TEST_F(JanitorTest, AStartCompletesDeletions) {
  const JobId job = Begin("j-1", 10, 10), without_row = Begin("j-2", 10, 10), running = Begin("j-3", 10, 10);
  for (const JobId& ended : {job, without_row}) {
    EXPECT_TRUE(store_.EndJob({ended, kJanitorsOwner.epoch}, {v1::JOB_STATE_DONE, ""}).ok());
  }
  EXPECT_TRUE(store_.DeleteJob(without_row).ok());
  for (const JobId& record : {job, without_row, running}) Write(data_.DeletionPath(record), 0);
  Make();
  EXPECT_TRUE(IsGone(job));
  EXPECT_TRUE(IsGone(without_row));
  EXPECT_FALSE(data_.IsBeingDeleted(running));
  EXPECT_TRUE(HasRow(running) && HasFilm(running) && HasResults(running));
}

TEST_F(JanitorTest, AJobThatRunsAgainIsLeftAloneUntilItsNextEnd) {
  const JobId job = Begin("j-1", 100, 10), other = Begin("j-2", 100, 10);
  limits_.film_bytes = 100;
  Make();
  End(job);
  janitor_->Keep(job);
  End(other);
  EXPECT_TRUE(HasFilm(job));
  EXPECT_TRUE(HasFilm(other));
}

TEST_F(JanitorTest, TheQuotaIsOfWhatCannotGo) {
  limits_.quota_bytes = 1000;
  const JobId running = Begin("j-1", 400, 0), ended = Begin("j-2", 0, 0);
  fs::resize_file(data_.ResultPath(ended, 0), 100);
  Make();
  const uint64_t manifest = fs::file_size(data_.ManifestPath(running));
  End(ended);
  now_ += absl::Seconds(20);
  janitor_->Poke();
  Settle();
  EXPECT_TRUE(janitor_->CheckQuota().ok());
  EXPECT_EQ(janitor_->Room(), 600 - manifest) << "what has ended makes room";
  disk_.free_bytes = 30;
  disk_.kept_bytes = 10;
  EXPECT_EQ(janitor_->Room(), 20u) << "of the disk";
  for (const uint64_t off : {1, 0}) {
    fs::resize_file(data_.PathOf(data_.UnitLogName(running, 0)), 1000 - manifest - off);
    now_ += absl::Seconds(20);
    janitor_->Poke();
    Settle();
    EXPECT_EQ(janitor_->CheckQuota().ok(), off == 1);
    EXPECT_EQ(janitor_->Room(), off);
  }
  EXPECT_THAT(janitor_->CheckQuota().ToString(),
              AllOf(HasSubstr("RESOURCE_EXHAUSTED"), HasSubstr("1000 bytes")));
  EXPECT_TRUE(IsGone(ended)) << "the quota is used up";
}

TEST_F(JanitorTest, WithoutAQuotaTheDiskIsTheRoom) {
  Make();
  EXPECT_EQ(janitor_->Room(), uint64_t{1} << 20);
  EXPECT_TRUE(janitor_->CheckQuota().ok());
}

TEST_F(JanitorTest, AfterARemovalThatFailedItPausesAndGoesOn) {
  const JobId job = Begin("j-1", 100, 10), other = Begin("j-2", 100, 10);
  limits_.film_bytes = 0;
  Make();
  files_.Fail(EIO, "/film/");
  End(job);
  End(other);
  EXPECT_TRUE(HasFilm(job) && HasFilm(other));
  files_.Heal();
  now_ += absl::Seconds(9);
  janitor_->Poke();
  Settle();
  EXPECT_TRUE(HasFilm(job)) << "ten seconds are not over";
  now_ += absl::Seconds(1);
  janitor_->Poke();
  Settle();
  EXPECT_FALSE(HasFilm(job) || HasFilm(other));
}

TEST_F(JanitorTest, ASweepTakesOldAssetsOfNoJobUnlessARowCannotBeRead) {
  const auto asset = [&](char digit) { return data_.AssetsPath() + "/" + std::string(64, digit); };
  const auto write_old = [&](char digit) {
    Write(asset(digit), 10);
    fs::last_write_time(asset(digit), fs::file_time_type::clock::now() - std::chrono::hours(24 * 8));
  };
  Begin("j-1", 10, 10, "a");
  Make();
  for (const char digit : {'a', 'b'}) write_old(digit);
  Write(asset('c'), 10);
  janitor_->Poke();
  Settle();
  EXPECT_TRUE(fs::exists(asset('b'))) << "it is not time yet";
  store_.is_damaged = true;
  now_ += absl::Seconds(20);
  janitor_->Poke();
  Settle();
  EXPECT_TRUE(fs::exists(asset('b'))) << "nobody knows what the job refers to";
  store_.is_damaged = false;
  now_ += absl::Seconds(20);
  janitor_->Poke();
  Settle();
  EXPECT_FALSE(fs::exists(asset('b')));
  EXPECT_TRUE(fs::exists(asset('a')) && fs::exists(asset('c')));
}

}  // namespace
}  // namespace lumifold::server
