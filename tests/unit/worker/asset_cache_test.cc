#include "worker/cache/asset_cache.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <vector>

#include "tests/unit/worker/fake_assets.h"
#include "tests/unit/worker/named_assets.h"

namespace lumifold::worker {
namespace {

using testing::ElementsAre;

v1::AssetRef Asset(const std::string& content) {
  v1::AssetRef asset;
  asset.set_uri(content);
  asset.set_sha256("sum of " + content);
  return asset;
}

TEST(AssetCache, FetchesAnAssetOnce) {
  NamedAssets source;
  AssetCache cache(&source, 100);
  for (const char* content : {"oak", "elm", "oak", "oak", "elm"})
    EXPECT_EQ(**cache.Fetch("j", Asset(content)), content);
  EXPECT_THAT(source.fetched, ElementsAre("oak", "elm"));
  EXPECT_EQ(cache.hits(), 3);
  EXPECT_EQ(cache.bytes(), 6u);
}

TEST(AssetCache, ThoseWhoFetchShareTheContent) {
  NamedAssets source;
  AssetCache cache(&source, 100);
  const AssetContent first = *cache.Fetch("j", Asset("oak"));
  EXPECT_EQ(*cache.Fetch("k", Asset("oak")), first);
}

TEST(AssetCache, ForgetsTheLeastRecentlyUsedOverItsLimit) {
  NamedAssets source;
  AssetCache cache(&source, 10);
  for (const char* content : {"oak", "elm", "oak", "pine", "beech"})
    cache.Fetch("j", Asset(content)).IgnoreError();
  source.fetched.clear();
  for (const char* content : {"beech", "pine", "oak"}) EXPECT_EQ(**cache.Fetch("j", Asset(content)), content);
  EXPECT_THAT(source.fetched, ElementsAre("oak"));  // beech and pine take 9 of the 10 bytes
}

TEST(AssetCache, DoesNotKeepWhatIsLargerThanItsLimit) {
  NamedAssets source;
  AssetCache cache(&source, 5);
  for (const char* content : {"oak", "chestnut", "oak", "chestnut"})
    EXPECT_EQ(**cache.Fetch("j", Asset(content)), content);
  EXPECT_THAT(source.fetched, ElementsAre("oak", "chestnut", "chestnut"));
}

TEST(AssetCache, DoesNotKeepErrors) {
  NamedAssets source;
  AssetCache cache(&source, 100);
  for (int i = 0; i < 2; ++i)
    EXPECT_EQ(cache.Fetch("j", Asset("missing")).status(), absl::NotFoundError("missing"));
  EXPECT_EQ(source.fetched.size(), 2u);
  EXPECT_EQ(cache.hits(), 0);
}

TEST(AssetCache, ThreadsShareWhatIsBeingFetched) {
  FakeAssets source{"oak"};
  source.SetOpen(false);
  AssetCache cache(&source, 100);
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&] { EXPECT_EQ(**cache.Fetch("j", Asset("oak")), "oak"); });
  source.AwaitFetches(1);
  source.SetOpen(true);
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(source.fetches(), 1);
}

}  // namespace
}  // namespace lumifold::worker
