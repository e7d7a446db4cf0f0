#include "filter/image/file_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

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

std::filesystem::perms ModeOf(const std::filesystem::path& path) {
  return std::filesystem::status(path).permissions();
}

TEST(FileIo, ANewFileHasTheModeOfTheUmaskAndOneThatIsReplacedKeepsItsOwn) {
  const auto folder = FreshFolder();
  const mode_t before = umask(002);
  ASSERT_TRUE(WriteFileAtomically(folder / "new", "x").ok());
  umask(before);
  EXPECT_EQ(ModeOf(folder / "new"), std::filesystem::perms(0664));
  std::filesystem::permissions(folder / "new", std::filesystem::perms(0640));
  ASSERT_TRUE(WriteFileAtomically(folder / "new", "y").ok());
  EXPECT_EQ(ModeOf(folder / "new"), std::filesystem::perms(0640));
  ASSERT_TRUE(WriteFileAtomically(folder / "new", "z", PrivateFileSystem()).ok());
  EXPECT_EQ(ModeOf(folder / "new"), std::filesystem::perms(0600)) << "a secret takes no mode of another file";
}

TEST(FileIo, WritesThroughALink) {
  const auto folder = FreshFolder();
  std::filesystem::create_directory(folder / "disk");
  std::filesystem::create_symlink("disk/real", folder / "link");
  for (const char* content : {"first", "second"}) {
    ASSERT_TRUE(WriteFileAtomically(folder / "link", content).ok());
    EXPECT_TRUE(std::filesystem::is_symlink(folder / "link"));
    EXPECT_EQ(ReadFile(folder / "disk/real", 99).value(), content);
  }
  ASSERT_TRUE(WriteFileAtomically(folder / "part", "third").ok());
  ASSERT_TRUE(MoveIntoPlace(folder / "part", folder / "link").ok());
  EXPECT_EQ(ReadFile(folder / "disk/real", 99).value(), "third");
  std::filesystem::create_symlink("circle", folder / "circle");
  EXPECT_TRUE(WriteFileAtomically(folder / "circle", "x").ok()) << "a link to itself is replaced";
}

TEST(FileIo, TakesNamesUpToTheLimitOfTheFileSystem) {
  const auto folder = FreshFolder();
  for (const size_t length : {251, 255}) {
    const std::string name(length, 'n');
    ASSERT_TRUE(WriteFileAtomically(folder / name, "x").ok()) << length;
    EXPECT_TRUE(std::filesystem::exists(folder / name));
  }
  EXPECT_FALSE(WriteFileAtomically(folder / std::string(256, 'n'), "x").ok());
  EXPECT_EQ(NameBeside("folder/" + std::string(255, 'n'), ".part"),
            "folder/" + std::string(250, 'n') + ".part");
  EXPECT_EQ(NameBeside("oak.exr", ".part"), "oak.exr.part");
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
