#include "proto/identity/private_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "tests/support/temp_folder.h"

namespace lumifold::identity {
namespace {

using ::testing::HasSubstr;

class PrivateFileTest : public ::testing::Test {
 protected:
  static mode_t ModeOf(const std::string& path) {
    struct stat info = {};
    EXPECT_EQ(lstat(path.c_str(), &info), 0) << path;
    return info.st_mode & 0777;
  }
  TempFolder folder_;
  const std::string path_ = folder_.PathOf("a/b/secret");
};

TEST_F(PrivateFileTest, IsForItsUserAloneWhateverTheMask) {
  const mode_t mask = umask(0);
  ASSERT_TRUE(MakePrivateFolder(folder_.PathOf("a/b")).ok());
  ASSERT_TRUE(WritePrivateFile(path_, "one").ok());
  ASSERT_TRUE(WritePrivateFile(path_, "two").ok());
  umask(mask);
  EXPECT_EQ(ModeOf(path_), 0600u);
  EXPECT_EQ(ModeOf(folder_.PathOf("a/b")), 0700u);
  EXPECT_EQ(ModeOf(folder_.PathOf("a")), 0700u);
  EXPECT_EQ(*ReadPrivateFile(path_, 3), "two");
  int files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder_.PathOf("a/b")))
    ++files;
  EXPECT_EQ(files, 1);
  EXPECT_TRUE(MakePrivateFolder(folder_.PathOf("a/b")).ok());
}

TEST_F(PrivateFileTest, RefusesWhatOthersCanReadOrThatIsNoFile) {
  ASSERT_TRUE(MakePrivateFolder(folder_.PathOf("a/b")).ok());
  EXPECT_EQ(ReadPrivateFile(path_, 9).status().code(), absl::StatusCode::kNotFound);
  ASSERT_TRUE(WritePrivateFile(path_, "secret").ok());
  EXPECT_EQ(ReadPrivateFile(path_, 5).status().code(), absl::StatusCode::kInvalidArgument);
  for (const mode_t mode : {0640u, 0604u, 0620u}) {
    ASSERT_EQ(chmod(path_.c_str(), mode), 0);
    const absl::Status status = ReadPrivateFile(path_, 9).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(status.message()), HasSubstr("chmod 600"));
  }
  ASSERT_EQ(chmod(path_.c_str(), 0600), 0);
  const std::string link = folder_.PathOf("link");
  ASSERT_EQ(symlink(path_.c_str(), link.c_str()), 0);
  EXPECT_EQ(ReadPrivateFile(link, 9).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(ReadPrivateFile(folder_.path(), 9).status().code(), absl::StatusCode::kInvalidArgument);
  const std::string pipe = folder_.PathOf("pipe");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(ReadPrivateFile(pipe, 9).status().code(),
            absl::StatusCode::kInvalidArgument);  // and does not wait
}

TEST_F(PrivateFileTest, SaysWhatCannotBeWritten) {
  const absl::Status status = WritePrivateFile(path_, "secret");
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(path_));
}

}  // namespace
}  // namespace lumifold::identity
