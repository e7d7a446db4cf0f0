#include "worker/cache/asset_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>

#include "proto/rpc/sha256.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/worker/named_assets.h"

namespace lumifold::worker {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

v1::AssetRef StoredAsset(const std::string& content) {
  v1::AssetRef asset;
  asset.set_uri(content);
  asset.set_size(content.size());
  asset.set_sha256(rpc::Sha256Hex(content));
  return asset;
}

class AssetFolderTest : public ::testing::Test {
 protected:
  AssetFolder Open(uint64_t max_bytes = 1000) {
    return AssetFolder(&source_, {.path = temp_.path(), .max_bytes = max_bytes});
  }
  std::string PathOf(const std::string& content) const { return temp_.PathOf(rpc::Sha256Hex(content)); }
  /// As if it had been used so long ago.
  static void Age(const std::string& path, std::chrono::minutes time) {
    fs::last_write_time(path, fs::file_time_type::clock::now() - time);
  }

  TempFolder temp_;
  NamedAssets source_;
};

TEST_F(AssetFolderTest, AnotherWorkerFetchesNothing) {
  EXPECT_EQ(**Open().Fetch("j-1", StoredAsset("oak")), "oak");
  AssetFolder other = Open();
  EXPECT_EQ(**other.Fetch("j-2", StoredAsset("oak")), "oak");
  EXPECT_EQ(other.hits(), 1);
  EXPECT_THAT(source_.fetched, ElementsAre("oak"));
}

TEST_F(AssetFolderTest, WhatIsNotTheAssetIsFetchedAgain) {
  for (const char* wrong : {"elm", "oa", "oak and more", ""}) {
    std::ofstream(PathOf("oak")) << wrong;
    source_.fetched.clear();
    EXPECT_EQ(**Open().Fetch("j", StoredAsset("oak")), "oak");
    EXPECT_THAT(source_.fetched, ElementsAre("oak"));
    EXPECT_EQ(fs::file_size(PathOf("oak")), 3u);
  }
}

TEST_F(AssetFolderTest, ErrorsAreNotKept) {
  EXPECT_EQ(Open().Fetch("j", StoredAsset("missing")).status().code(), absl::StatusCode::kNotFound);
  EXPECT_TRUE(fs::is_empty(temp_.path()));
}

TEST_F(AssetFolderTest, TheLeastRecentlyUsedGo) {
  AssetFolder folder = Open(10);
  for (const char* content : {"oak", "elm", "fir"}) EXPECT_TRUE(folder.Fetch("j", StoredAsset(content)).ok());
  Age(PathOf("oak"), std::chrono::minutes(3));
  Age(PathOf("elm"), std::chrono::minutes(2));
  EXPECT_TRUE(folder.Fetch("j", StoredAsset("oak")).ok());  // used now
  EXPECT_TRUE(folder.Fetch("j", StoredAsset("pine")).ok());
  EXPECT_TRUE(fs::exists(PathOf("oak")));
  EXPECT_FALSE(fs::exists(PathOf("elm")));
  EXPECT_TRUE(fs::exists(PathOf("pine")));
  EXPECT_TRUE(folder.Fetch("j", StoredAsset("larger than all of it")).ok());
  EXPECT_FALSE(fs::exists(PathOf("larger than all of it")));
}

TEST_F(AssetFolderTest, RemovesWhatInterruptedWritesLeftAndNothingElse) {
  const std::string old = PathOf("oak") + ".12.partial";
  const std::string recent = PathOf("oak") + ".13.partial";
  const std::string foreign = temp_.PathOf("notes.txt");
  for (const std::string& path : {old, recent, foreign}) std::ofstream(path) << "x";
  Age(old, std::chrono::hours(2));
  Age(foreign, std::chrono::hours(2));
  EXPECT_TRUE(Open(3).Fetch("j", StoredAsset("elm")).ok());
  EXPECT_FALSE(fs::exists(old));
  EXPECT_TRUE(fs::exists(recent));
  EXPECT_TRUE(fs::exists(foreign));
}

TEST_F(AssetFolderTest, AFolderThatCannotBeWrittenCostsTheKeepingOnly) {
  AssetFolder folder(&source_, {.path = temp_.PathOf("none")});
  EXPECT_EQ(**folder.Fetch("j", StoredAsset("oak")), "oak");
  EXPECT_EQ(**folder.Fetch("j", StoredAsset("oak")), "oak");
  EXPECT_THAT(source_.fetched, ElementsAre("oak", "oak"));
}

TEST(MakeAssetFolder, IsForItsOwnerAlone) {
  const TempFolder temp;
  const std::string path = temp.PathOf("assets");
  ASSERT_TRUE(MakeAssetFolder(path, geteuid()).ok());
  ASSERT_TRUE(MakeAssetFolder(path, geteuid()).ok());  // it may be there
  struct stat info = {};
  ASSERT_EQ(stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0700u);
}

TEST(MakeAssetFolder, RefusesAFolderOfSomebodyElse) {
  const TempFolder temp;
  EXPECT_THAT(std::string(MakeAssetFolder(temp.path(), geteuid() + 1).message()), HasSubstr("another user"));
  ASSERT_EQ(chmod(temp.path().c_str(), 0777), 0);
  EXPECT_THAT(std::string(MakeAssetFolder(temp.path(), geteuid()).message()), HasSubstr("by others"));
  const std::string file = temp.PathOf("file");
  std::ofstream(file) << "x";
  EXPECT_THAT(std::string(MakeAssetFolder(file, geteuid()).message()), HasSubstr("not a folder"));
}

}  // namespace
}  // namespace lumifold::worker
