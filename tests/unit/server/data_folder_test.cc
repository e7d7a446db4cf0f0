#include "server/storage/data_folder.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "server/storage/disk_space.h"
#include "tests/unit/server/faulty_files.h"

namespace lumifold::server {
namespace {

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

}  // namespace
}  // namespace lumifold::server
