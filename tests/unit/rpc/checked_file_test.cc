#include "proto/rpc/checked_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace lumifold::rpc {
namespace {

using testing::EndsWith;

constexpr CheckedFileType kType = {"LFX2", "the list", 1 << 10};

/// What reading the file as `type` says after `content` was written as kType.
std::string ErrorOf(const CheckedFileType& type) {
  const std::string path = testing::TempDir() + "/checked";
  EXPECT_TRUE(WriteCheckedFile(path, kType, "content", RealFileSystem()).ok());
  const absl::StatusOr<std::string> content = ReadCheckedFile(path, type);
  if (content.ok()) return "none: " + *content;
  EXPECT_EQ(content.status().code(), absl::StatusCode::kDataLoss);
  return std::string(content.status().message());
}

TEST(CheckedFile, ReadsWhatWasWritten) { EXPECT_EQ(ErrorOf(kType), "none: content"); }

TEST(CheckedFile, TellsAnotherVersionFromDamage) {
  EXPECT_THAT(ErrorOf({"LFX3", "the list", 1 << 10}),
              EndsWith("checked: the list was written by another version"));
  EXPECT_THAT(ErrorOf({"LFY2", "the list", 1 << 10}), EndsWith("checked: the list is damaged"));
}

}  // namespace
}  // namespace lumifold::rpc
