#include "client/farm/download.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <utility>

#include "tests/unit/client/fake_farm.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;

class DownloadTest : public testing::Test {
 protected:
  DownloadTest() {
    for (int i = 0; i < 5500; ++i) farm_.result += static_cast<char>(i * 7 + i / 256);
  }

  absl::Status Download() {
    QuietProgress progress(test_.err);
    return Download(&progress);
  }

  absl::Status Download(Progress* progress) {
    const auto client = MakeFarmClient(farm_.channel(), {.coordinators = {farm_.address()},
                                                         .time = time_.Environment(),
                                                         .interrupted = test_.environment.interrupted});
    return DownloadFrame(*client, "job-1", 0, folder_.File("part"), *progress,
                         Backoff(absl::Minutes(1), time_.Environment(), test_.environment.interrupted));
  }

  FakeFarm farm_;
  ScratchFolder folder_;
  TestEnvironment test_;
  FakeTime time_;
};

TEST(PartPath, TellsJobsAndFramesApart) {
  EXPECT_EQ(PartPath("out.exr", "j-1", 3).value(), "out.exr.j-1-3.part");
}

TEST(PartPath, RefusesWhatCannotBeAJob) {
  for (const char* id : {"", "../x", "a b", "a/b"}) {
    EXPECT_EQ(PartPath("out.exr", id, 0).status(), absl::NotFoundError("no job '" + std::string(id) + "'"));
  }
}

TEST_F(DownloadTest, LeavesNothingWhereTheJobIsUnknown) {
  farm_.result.clear();
  EXPECT_EQ(Download(), absl::NotFoundError("no job 'job-1'"));
  EXPECT_EQ(folder_.FileCount(), 0);
}

TEST_F(DownloadTest, GoesOnWhereAConnectionBroke) {
  farm_.break_downloads = {2000, 2000, 5000};
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), farm_.result);
  EXPECT_THAT(farm_.download_offsets(), ElementsAre(0, 2000, 2000, 5000));
  EXPECT_GT(time_.sleeps, 0);
}

TEST_F(DownloadTest, GoesOnWithWhatAnEarlierCallLeft) {
  folder_.Write("part", farm_.result.substr(0, 1234));
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), farm_.result);
  EXPECT_THAT(farm_.download_offsets(), ElementsAre(1234));
}

TEST_F(DownloadTest, IsContentWithAPartThatIsWhole) {
  folder_.Write("part", farm_.result);
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), farm_.result);
}

TEST_F(DownloadTest, BeginsAnewWhereThePartIsLongerThanTheFile) {
  folder_.Write("part", farm_.result + "more");
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), farm_.result);
  EXPECT_THAT(farm_.download_offsets(), ElementsAre(5504, 0));
}

TEST_F(DownloadTest, BeginsAnewOnceWhereThePartIsGarbage) {
  folder_.Write("part", std::string(1234, '?'));
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), farm_.result);
  EXPECT_THAT(farm_.download_offsets(), ElementsAre(1234, 0));
  EXPECT_THAT(test_.err.str(), testing::ContainsRegex("frame 0 of job job-1: its SHA-256 is .*again\n"));
}

TEST_F(DownloadTest, BeginsAnewWhereAPartOfTheRightSizeIsGarbage) {
  folder_.Write("part", std::string(farm_.result.size(), '?'));
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), farm_.result);
}

TEST_F(DownloadTest, RefusesAFileWithChangedBytes) {
  std::string changed = farm_.result;
  changed[4321] ^= 1;
  farm_.sent_results = {changed};
  const absl::Status status = Download();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(
      std::string(status.message()),
      testing::MatchesRegex("frame 0 of job job-1: its SHA-256 is [0-9a-f]+, the coordinator states .*"));
  EXPECT_EQ(folder_.FileCount(), 0);
}

TEST_F(DownloadTest, HealsBytesThatChangedBeforeAConnectionBroke) {
  std::string changed = farm_.result;
  changed[123] ^= 1;
  farm_.sent_results = {changed};
  farm_.break_downloads = {3000};
  EXPECT_EQ(Download(), absl::OkStatus());
  EXPECT_EQ(folder_.Read("part"), farm_.result);
  EXPECT_THAT(farm_.download_offsets(), ElementsAre(0, 3000, 0));
}

TEST_F(DownloadTest, BeginsAnewOnceOnly) {
  folder_.Write("part", std::string(1234, '?'));
  farm_.stated_sha256 = std::string(64, '0');
  EXPECT_EQ(Download().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(farm_.download_offsets(), ElementsAre(1234, 0));
  EXPECT_EQ(folder_.FileCount(), 0);
}

TEST_F(DownloadTest, GivesUpWhenNothingMovesAndKeepsWhatItHas) {
  farm_.break_downloads.assign(1000, 3000);
  const absl::Time begin = time_.now;
  EXPECT_EQ(Download().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(folder_.Read("part"), farm_.result.substr(0, 3000));
  EXPECT_GE(time_.now - begin, absl::Minutes(1));
}

TEST_F(DownloadTest, StopsWhenTheUserInterrupts) {
  test_.interrupted = true;
  EXPECT_EQ(Download(), absl::CancelledError("interrupted"));
}

TEST_F(DownloadTest, NamesTheFileTheDiskRefuses) {
  folder_.Write("part/in-the-way", "");
  const absl::Status status = Download();
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("/part: "));
}

/// Removes a file each time that progress is shown.
class RemovingProgress : public Progress {
 public:
  explicit RemovingProgress(std::string path) : path_(std::move(path)) {}
  void Update(const ProgressState&) override { std::filesystem::remove(path_); }
  void Message(absl::string_view) override {}
  void Clear() override {}

 private:
  const std::string path_;
};

TEST_F(DownloadTest, AFileThatIsRemovedMeanwhileIsAnErrorOfThisMachine) {
  RemovingProgress progress(folder_.File("part"));
  const absl::Status status = Download(&progress);
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("/part: "));
}

}  // namespace
}  // namespace lumifold::client
