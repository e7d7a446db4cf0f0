#include "server/storage/data_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "filter/image/file_io.h"
#include "server/storage/disk_space.h"
#include "server/storage/folder_contents.h"
#include "server/storage/manifest.h"
#include "server/storage/reserve_file.h"
#include "server/storage/storage_state.h"
#include "tests/support/filled_message.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/server/faulty_files.h"

namespace lumifold::server {
namespace {

using job::JobId;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

void WriteBytes(const std::string& path, size_t bytes) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path) << std::string(bytes, 'x');
}

TEST(RemoveAll, IsContentWhereAnotherRemovesAFileMeanwhile) {
  const std::string folder = ::testing::TempDir() + "lumifold_remove_all";
  std::filesystem::create_directories(folder + "/inner");
  for (const char* name : {"/a", "/inner/b", "/inner/c"}) std::ofstream(folder + name) << "content";
  FaultyFiles files;
  files.OnCall([](const std::string& path) {
    if (path.ends_with("/b")) std::filesystem::remove(path);
  });
  EXPECT_EQ(RemoveAll(folder, &files), absl::OkStatus());
  EXPECT_FALSE(std::filesystem::exists(folder));
  EXPECT_EQ(RemoveAll(folder, &files), absl::OkStatus()) << "nothing is there";
}

TEST(DiskSpace, HasRoomBeyondWhatIsKept) {
  EXPECT_EQ((DiskSpace{.free_bytes = 100, .kept_bytes = 30}).room(), 70u);
  EXPECT_EQ((DiskSpace{.free_bytes = 30, .kept_bytes = 30}).room(), 0u);
  EXPECT_EQ((DiskSpace{.free_bytes = 20, .kept_bytes = 30}).room(), 0u);
}

TEST(FolderContents, AreTheFilesWithTheNamesOfFrames) {
  TempFolder folder;
  const DataFolder data(folder.path()), other = data.WithLogsOf("e7");
  const JobId job("j-2");
  WriteBytes(data.PathOf(data.UnitLogName(job, 12)), 5);
  WriteBytes(other.PathOf(other.UnitLogName(job, 12)), 6);
  WriteBytes(data.PathOf(data.UnitLogName(job, 10000)), 7);
  for (const char* name : {"/frame-x.units", "/other-0001.units", "/frame-0001.rounds", "/manifest"})
    WriteBytes(data.FilmPath(job) + name, 1);
  std::vector<std::string> logs;
  for (const UnitLogFile& log : UnitLogsOf(data, job))
    logs.push_back(log.name + " " + std::to_string(log.frame) + " " + std::to_string(log.bytes));
  EXPECT_THAT(logs, ElementsAre("film/j-2/frame-0012.e7.units 12 6", "film/j-2/frame-0012.units 12 5",
                                "film/j-2/frame-10000.units 10000 7"));
  EXPECT_EQ(UnitLogsOf(data, job, 12).size(), 2u);
  EXPECT_THAT(UnitLogsOf(data, job, 1), IsEmpty());
  for (const int frame : {10000, 9, 10}) WriteBytes(data.ResultPath(job, frame), 1);
  WriteBytes(data.ResultPath(job, 11) + ".sha256", 1);
  EXPECT_THAT(ResultsOf(data, job), ElementsAre(9, 10, 10000));
  EXPECT_THAT(ResultsOf(data, JobId("j-none")), IsEmpty());
  WriteBytes(data.ManifestPath(JobId("j-1")), 1);
  EXPECT_THAT(JobsWithFilm(data), ElementsAre(JobId("j-1"), JobId("j-2")));
  EXPECT_THAT(JobsWithResults(data), ElementsAre(JobId("j-2")));
}

TEST(FolderContents, LeftoversAreFilesThatAreNotComplete) {
  TempFolder folder;
  FaultyFiles files;
  const DataFolder data(folder.path(), &files);
  const JobId job("j-1"), other("j-2");
  EXPECT_TRUE(RemoveLeftovers(data).ok()) << "there is no folder yet";
  const auto part = [](const std::string& path) { return path + kPartialSuffix; };
  for (const JobId& each : {job, other}) {
    WriteBytes(data.ResultPath(each, 0), 1);
    WriteBytes(part(data.ResultPath(each, 1)), 1);
    WriteBytes(part(data.ManifestPath(each)), 1);
  }
  files.Fail(EIO, kPartialSuffix);
  EXPECT_TRUE(absl::IsUnavailable(RemoveLeftoversOf(data, job)));
  files.Heal();
  EXPECT_TRUE(RemoveLeftoversOf(data, job).ok());
  EXPECT_FALSE(std::filesystem::exists(part(data.ResultPath(job, 1))));
  EXPECT_FALSE(std::filesystem::exists(part(data.ManifestPath(job))));
  EXPECT_TRUE(std::filesystem::exists(part(data.ResultPath(other, 1))));
  EXPECT_TRUE(RemoveLeftovers(data).ok());
  EXPECT_FALSE(std::filesystem::exists(part(data.ResultPath(other, 1))));
  EXPECT_FALSE(std::filesystem::exists(part(data.ManifestPath(other))));
  EXPECT_TRUE(std::filesystem::exists(data.ResultPath(job, 0)));
}

/// A job whose fields all differ.
ledger::NewJob FilledJob() {
  ledger::NewJob job;
  job.id = JobId("j-1");
  job.request_id = "request";
  job.spec = FilledMessage<v1::JobSpec>(1);
  job.scheduling = FilledMessage<v1::Scheduling>(1000);
  job.submitted = absl::FromUnixMillis(1'700'000'000'123);
  job.owner = {"owner", ledger::Epoch(7)};
  return job;
}

TEST(Manifest, HasAllOfAJobUntilAndAfterItsEnd) {
  TempFolder folder;
  const DataFolder data(folder.path());
  const ledger::NewJob job = FilledJob();
  ASSERT_TRUE(WriteManifest(data, ManifestOf(job)).ok());
  const ledger::NewJob read = JobOf(*ReadManifest(data.ManifestPath(job.id)), job.owner);
  EXPECT_EQ(read.id, job.id);
  EXPECT_EQ(read.request_id, "request");
  EXPECT_EQ(read.spec.DebugString(), job.spec.DebugString());
  EXPECT_EQ(read.scheduling.DebugString(), job.scheduling.DebugString());
  EXPECT_EQ(read.submitted, job.submitted);
  EXPECT_EQ(read.owner, job.owner);

  const auto spec = FilledMessage<v1::JobSpec>(5000);
  const auto scheduling = FilledMessage<v1::Scheduling>(6000);
  ASSERT_TRUE(RewriteManifest(data, job.id, spec).ok());
  EXPECT_EQ(ReadManifest(data.ManifestPath(job.id))->spec().DebugString(), spec.DebugString());
  EXPECT_EQ(ReadManifest(data.ManifestPath(job.id))->scheduling().DebugString(),
            job.scheduling.DebugString());
  ASSERT_TRUE(RewriteManifest(data, job.id, scheduling).ok());
  EXPECT_EQ(ReadManifest(data.ManifestPath(job.id))->scheduling().DebugString(), scheduling.DebugString());
  EXPECT_TRUE(absl::IsNotFound(RewriteManifest(data, JobId("j-none"), spec)));

  for (int again = 0; again < 2; ++again) {
    ASSERT_TRUE(RetireJob(data, job.id, v1::JOB_STATE_CANCELLED, "by ann").ok());
    EXPECT_TRUE(absl::IsNotFound(ReadManifest(data.ManifestPath(job.id)).status()));
    EXPECT_EQ(ReadManifest(data.EndedManifestPath(job.id))->end_state(), v1::JOB_STATE_CANCELLED);
    EXPECT_EQ(ReadManifest(data.EndedManifestPath(job.id))->error(), "by ann");
  }
  ledger::JobRecord record;
  record.id = job.id;
  record.spec = job.spec;
  record.scheduling = job.scheduling;
  record.submitted = absl::FromUnixSeconds(1);
  for (int again = 0; again < 2; ++again) {
    ASSERT_TRUE(UnretireJob(data, record).ok());
    EXPECT_TRUE(absl::IsNotFound(ReadManifest(data.EndedManifestPath(job.id)).status()));
    EXPECT_EQ(ReadManifest(data.ManifestPath(job.id))->DebugString(), ManifestOf(job).DebugString());
  }
}

TEST(Manifest, OneThatIsDamagedIsMadeOfTheRow) {
  TempFolder folder;
  FaultyFiles files;
  const DataFolder data(folder.path(), &files);
  const ledger::NewJob job = FilledJob();
  WriteBytes(data.EndedManifestPath(job.id), 100);
  EXPECT_TRUE(absl::IsDataLoss(ReadManifest(data.EndedManifestPath(job.id)).status()));
  ledger::JobRecord record;
  record.id = job.id;
  record.spec = job.spec;
  record.scheduling = job.scheduling;
  record.submitted = job.submitted;
  files.Fail(EIO, "/film/");
  EXPECT_TRUE(absl::IsUnavailable(UnretireJob(data, record)));
  EXPECT_TRUE(std::filesystem::exists(data.EndedManifestPath(job.id)));
  files.Heal();
  ASSERT_TRUE(UnretireJob(data, record).ok());
  v1::JobManifest expected = ManifestOf(job);
  expected.set_request_id("of j-1");
  EXPECT_EQ(ReadManifest(data.ManifestPath(job.id))->DebugString(), expected.DebugString());
}

TEST(StorageState, AnOutageHasItsFirstCauseAndEndsOnce) {
  absl::Time now = absl::FromUnixSeconds(5);
  StorageState state([&] { return now; }, std::make_shared<spdlog::logger>("none"));
  std::vector<bool> changes;
  int failures = 0;
  state.OnChange([&](bool works) { changes.push_back(works); });
  state.OnFail([&] { ++failures; });
  state.Recover();
  EXPECT_TRUE(state.ok());
  EXPECT_THAT(changes, IsEmpty());
  state.Fail(absl::UnavailableError("full"));
  now += absl::Seconds(1);
  state.Fail(absl::DataLossError("broken"));
  EXPECT_FALSE(state.ok());
  EXPECT_EQ(state.outage()->error, "full");
  EXPECT_EQ(state.outage()->since, absl::FromUnixSeconds(5));
  EXPECT_TRUE(absl::IsUnavailable(state.status()));
  EXPECT_THAT(state.status().message(), HasSubstr("full"));
  EXPECT_EQ(failures, 2);
  EXPECT_THAT(changes, ElementsAre(false));
  state.Recover();
  state.Recover();
  EXPECT_TRUE(state.ok());
  EXPECT_TRUE(state.status().ok());
  EXPECT_THAT(changes, ElementsAre(false, true));
  state.Fail(absl::DataLossError("broken"));
  EXPECT_EQ(state.outage()->error, "broken");
  EXPECT_EQ(state.outage()->since, absl::FromUnixSeconds(6));
  for (const auto code : {absl::StatusCode::kUnavailable, absl::StatusCode::kDataLoss})
    EXPECT_TRUE(IsStorageError(absl::Status(code, "")));
  for (const auto code : {absl::StatusCode::kOk, absl::StatusCode::kInternal, absl::StatusCode::kNotFound,
                          absl::StatusCode::kResourceExhausted})
    EXPECT_FALSE(IsStorageError(absl::Status(code, "")));
}

TEST(ReserveFile, IsTakenOnceAndAgainWhenItWasGivenUp) {
  TempFolder folder;
  FaultyFiles files;
  const std::string path = folder.PathOf("reserve");
  ReserveFile reserve(path, 5000, &files);
  reserve.GiveUp();
  EXPECT_FALSE(std::filesystem::exists(path)) << "it was never taken";
  files.Fail(ENOSPC);
  EXPECT_THAT(reserve.Take().ToString(), HasSubstr("No space left on device"));
  files.Heal();
  EXPECT_TRUE(reserve.Take().ok());
  EXPECT_EQ(std::filesystem::file_size(path), 5000u);
  const int64_t calls = files.calls();
  EXPECT_TRUE(reserve.Take().ok());
  EXPECT_EQ(files.calls(), calls) << "it is held";
  reserve.GiveUp();
  EXPECT_EQ(std::filesystem::file_size(path), 0u);
  EXPECT_TRUE(reserve.Take().ok());
  EXPECT_EQ(std::filesystem::file_size(path), 5000u);
  ReserveFile none(path, 0, &files);
  EXPECT_TRUE(none.Take().ok());
  EXPECT_EQ(std::filesystem::file_size(path), 0u);
}

}  // namespace
}  // namespace lumifold::server
