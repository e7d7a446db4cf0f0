#include "filter/image/file_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

namespace lumifold {
namespace {

using ::testing::HasSubstr;

/// An empty folder for each test.
std::filesystem::path FreshFolder() {
  const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
  const auto folder =
      std::filesystem::path(::testing::TempDir()) / (std::string("lumifold_file_io_") + test->name());
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  return folder;
}

TEST(FileIo, ReadsBackWhatItWroteAndLeavesNothingBeside) {
  const auto folder = FreshFolder();
  const std::string path = folder / "data.bin";
  const std::string bytes("a\0b\n", 4);
  ASSERT_TRUE(WriteFileAtomically(path, "old content, longer").ok());
  ASSERT_TRUE(WriteFileAtomically(path, bytes).ok());
  const auto read = ReadFile(path, 100);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(*read, bytes);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder), {}), 1);
}

TEST(FileIo, NamesThePathThatCannotBeWritten) {
  const std::string path = FreshFolder() / "no_such_folder" / "data.bin";
  const absl::Status status = WriteFileAtomically(path, "x");
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(path));
}

TEST(FileIo, CleansUpWhenTheTargetIsAFolder) {
  const auto folder = FreshFolder();
  std::filesystem::create_directories(folder / "taken" / "inside");
  EXPECT_EQ(WriteFileAtomically(folder / "taken", "x").code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder), {}), 1);
}

TEST(FileIo, RefusesMissingFoldersAndTooLargeFiles) {
  const auto folder = FreshFolder();
  EXPECT_EQ(ReadFile(folder / "missing", 10).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(ReadFile(folder, 1 << 20).status().code(), absl::StatusCode::kInvalidArgument);
  ASSERT_TRUE(WriteFileAtomically(folder / "big", "12345").ok());
  EXPECT_EQ(ReadFile(folder / "big", 4).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(ReadFile(folder / "big", 5).ok());
}

}  // namespace
}  // namespace lumifold
