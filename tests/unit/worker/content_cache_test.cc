#include "worker/cache/content_cache.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

namespace lumifold::worker {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class ContentCacheTest : public ::testing::Test {
 protected:
  /// The value of `key`, which is the key itself and has as many bytes.
  std::shared_ptr<const std::string> Get(const std::string& key) {
    const auto make = [&]() -> absl::StatusOr<std::shared_ptr<const std::string>> {
      made_.push_back(key);
      return std::make_shared<const std::string>(key);
    };
    return *cache_.Get(key, make, [](const std::string& value) -> uint64_t { return value.size(); });
  }

  ContentCache<std::string> cache_{10};
  std::vector<std::string> made_;
};

TEST_F(ContentCacheTest, AValueInUseIsFoundBeyondTheLimit) {
  const auto large = Get("a large value");
  const auto oak = Get("oak");
  for (const char* key : {"beech", "maple"}) Get(key);  // together they take all 10 bytes
  made_.clear();
  EXPECT_EQ(Get("a large value"), large);
  EXPECT_EQ(Get("oak"), oak);
  EXPECT_THAT(made_, IsEmpty());
}

TEST_F(ContentCacheTest, AValueBeyondTheLimitThatNobodyUsesIsMadeAgain) {
  for (const char* key : {"a large value", "oak", "beech", "maple"}) Get(key);
  made_.clear();
  for (const char* key : {"maple", "beech", "oak", "a large value"}) Get(key);
  EXPECT_THAT(made_, ElementsAre("oak", "a large value"));
}

TEST_F(ContentCacheTest, AValueThatIsFoundAgainIsKeptAgain) {
  auto oak = Get("oak");
  for (const char* key : {"beech", "maple"}) Get(key);
  Get("oak");
  oak.reset();
  made_.clear();
  Get("oak");
  EXPECT_THAT(made_, IsEmpty());
}

}  // namespace
}  // namespace lumifold::worker
