#include "client/autoscale/state_file.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temp_folder.h"

namespace lumifold::autoscale {
namespace {

History MadeUp() {
  History history;
  history.refusals = {
      .failures = 3, .last = absl::UnixEpoch() + absl::Seconds(1000), .why = "no \"partition\""};
  history.counted_ends = {"7/12", "8/13"};
  history.period_start = absl::UnixEpoch();
  history.spent_core_seconds = 12.5;
  history.charges["9/14"] = {.cores = 8,
                             .from = absl::UnixEpoch() + absl::Seconds(5),
                             .until = absl::UnixEpoch() + absl::Seconds(9)};
  history.seconds_per_unit = 2.25;
  return history;
}

TEST(StateFile, GivesBackWhatWasWritten) {
  const TempFolder folder;
  {
    auto file = StateFile::Open(folder.PathOf("state"));
    ASSERT_TRUE(file.ok()) << file.status();
    EXPECT_EQ(HistoryJson(*file->Read()), HistoryJson(History()));
    ASSERT_TRUE(file->Write(MadeUp()).ok());
  }
  const auto again = StateFile::Open(folder.PathOf("state"));
  const auto history = again->Read();
  ASSERT_TRUE(history.ok()) << history.status();
  EXPECT_EQ(HistoryJson(*history), HistoryJson(MadeUp()));
  EXPECT_EQ(history->UsedCoreSeconds(), 12.5 + 32);
  EXPECT_EQ(history->deaths.last, absl::InfinitePast());
}

TEST(StateFile, OneProcessHasIt) {
  const TempFolder folder;
  const auto first = StateFile::Open(folder.PathOf("state"));
  EXPECT_EQ(StateFile::Open(folder.PathOf("state")).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST(StateFile, ADamagedFileIsAnErrorAndStays) {
  const TempFolder folder;
  auto file = StateFile::Open(folder.PathOf("state"));
  ASSERT_TRUE(file->Write(MadeUp()).ok());
  std::fstream(folder.PathOf("state"), std::ios::in | std::ios::out).seekp(40).put('#');
  EXPECT_EQ(file->Read().status().code(), absl::StatusCode::kDataLoss);
}

TEST(StateFile, RefusesJsonThatIsNoHistory) {
  for (const char* text : {"", "[]", "{}", "null", R"({"refusals":1})"})
    EXPECT_FALSE(ParseHistory(text).ok()) << text;
}

}  // namespace
}  // namespace lumifold::autoscale
