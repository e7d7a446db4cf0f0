#include "filter/image/file_calls.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <string>
#include <string_view>

#include "filter/image/file_io.h"
#include "tests/support/temp_folder.h"

namespace lumifold {
namespace {

TEST(FileCalls, OnlyAMissingFileIsNotFound) {
  EXPECT_EQ(FileError("a.exr", ENOENT), absl::NotFoundError("a.exr: No such file or directory"));
  EXPECT_EQ(FileError("a/b.exr", -ENOTDIR), absl::NotFoundError("a/b.exr: Not a directory"));
  EXPECT_EQ(FileError("a.exr", EACCES), absl::UnavailableError("a.exr: Permission denied"));
}

TEST(FileCalls, ErrorsOfTheStorageMayPass) {
  EXPECT_EQ(StorageError("/data/film", -ENOENT),
            absl::UnavailableError("/data/film: No such file or directory"));
  EXPECT_EQ(StorageError("/data/film", ENOSPC),
            absl::UnavailableError("/data/film: No space left on device"));
  EXPECT_EQ(WriteError("a.exr", -EIO), absl::UnavailableError("cannot write a.exr: Input/output error"));
}

TEST(FileCalls, ReadsAtAnOffsetUpToTheEnd) {
  const TempFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder.PathOf("text"), "0123456789").ok());
  const int file = open(folder.PathOf("text").c_str(), O_RDONLY | O_CLOEXEC);
  std::array<char, 8> bytes = {};
  EXPECT_EQ(ReadAt(file, 1, bytes.data(), 4), 4);
  EXPECT_EQ(std::string_view(bytes.data(), 4), "1234");
  EXPECT_EQ(ReadAt(file, 7, bytes.data(), bytes.size()), 3);
  EXPECT_EQ(std::string_view(bytes.data(), 3), "789");
  EXPECT_EQ(ReadAt(file, 10, bytes.data(), bytes.size()), 0);
  EXPECT_EQ(ReadNext(file, bytes.data(), 2), 2);  // its position has not moved
  EXPECT_EQ(std::string_view(bytes.data(), 2), "01");
  close(file);
  EXPECT_EQ(ReadAt(file, 0, bytes.data(), 1), -EBADF);
  EXPECT_EQ(ReadNext(file, bytes.data(), 1), -EBADF);
}

}  // namespace
}  // namespace lumifold
