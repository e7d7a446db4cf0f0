#include "server/film/result_digest.h"

#include <gtest/gtest.h>

#include <fstream>

#include "proto/rpc/sha256.h"
#include "tests/support/temp_folder.h"

namespace lumifold::film {
namespace {

class ResultDigestTest : public testing::Test {
 protected:
  void WriteResult(const std::string& content) { std::ofstream(path_, std::ios::binary) << content; }

  TempFolder folder_;
  const std::string path_ = folder_.PathOf("frame-0001.exr");
};

TEST_F(ResultDigestTest, IsThatOfTheResultWhenItWasWritten) {
  WriteResult("written");
  EXPECT_EQ(*MakeResultDigest(path_), rpc::Sha256Hex("written"));
  WriteResult("damaged");
  EXPECT_EQ(*ResultDigest(path_), rpc::Sha256Hex("written"));
  EXPECT_EQ(*MakeResultDigest(path_), rpc::Sha256Hex("damaged"));
}

TEST_F(ResultDigestTest, IsMadeForAResultOfAnOlderVersion) {
  WriteResult("written");
  EXPECT_EQ(*ResultDigest(path_), rpc::Sha256Hex("written"));
  WriteResult("damaged");
  EXPECT_EQ(*ResultDigest(path_), rpc::Sha256Hex("written"));
}

TEST_F(ResultDigestTest, IsMadeAgainWhereItsOwnFileIsDamaged) {
  WriteResult("written");
  std::ofstream(path_ + ".sha256") << "not a digest";
  EXPECT_EQ(*ResultDigest(path_), rpc::Sha256Hex("written"));
}

TEST_F(ResultDigestTest, NamesAMissingResult) {
  EXPECT_EQ(ResultDigest(path_).status(), absl::NotFoundError(path_ + ": No such file or directory"));
}

}  // namespace
}  // namespace lumifold::film
