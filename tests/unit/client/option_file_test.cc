#include "client/cli/option_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

absl::StatusOr<OptionFile> Parse(const std::string& text, OptionFileKind kind = OptionFileKind::kJob) {
  return ParseOptionFile("job.yaml", text, kind);
}

std::string OptionError(const std::string& text, OptionFileKind kind = OptionFileKind::kJob) {
  const absl::Status status = Parse(text, kind).status();
  EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
  return std::string(status.message());
}

TEST(OptionFile, HasNamesValuesAndLines) {
  const OptionFile file = *Parse("# a job\nspp: 64\nframes: [1-48, 60]\nadaptive: true\n");
  ASSERT_EQ(file.options.size(), 3u);
  EXPECT_EQ(file.options[0].name, "spp");
  EXPECT_THAT(file.options[0].values, ElementsAre("64"));
  EXPECT_EQ(file.options[0].line, 2);
  EXPECT_THAT(file.options[1].values, ElementsAre("1-48", "60"));
  EXPECT_EQ(file.options[2].line, 4);
}

TEST(OptionFile, MayBeJsonOrEmpty) {
  EXPECT_EQ(Parse(R"({"scene": "room.glb", "tag": ["gpu", "night"]})")->options.size(), 2u);
  EXPECT_TRUE(Parse("")->options.empty());
}

TEST(OptionFile, AConfigurationHasProfiles) {
  const char* const text = "server: a:7700\nprofiles:\n  night:\n    priority: -10\n";
  const OptionFile file = *Parse(text, OptionFileKind::kConfiguration);
  EXPECT_EQ(file.options.size(), 1u);
  ASSERT_EQ(file.profiles.count("night"), 1u);
  EXPECT_EQ(file.profiles.at("night")[0].line, 4);
  EXPECT_THAT(OptionError(text), HasSubstr("job.yaml:2: profiles: expected a value"));
}

TEST(OptionFile, NamesTheLineThatIsWrong) {
  EXPECT_THAT(OptionError("spp: 1\nspp: 2\n"), HasSubstr("job.yaml:2: spp appears twice"));
  EXPECT_THAT(OptionError("- spp\n"), HasSubstr("job.yaml:1: expected lines of 'option: value'"));
  EXPECT_THAT(OptionError("size: 3\nspp: {a: 1}\n"), HasSubstr("job.yaml:2: spp: expected a value"));
  EXPECT_THAT(OptionError("spp: [[1]]\n"), HasSubstr("job.yaml:1: spp"));
  EXPECT_THAT(OptionError("spp:\n"), HasSubstr("job.yaml:1: spp: expected a value"));
  EXPECT_THAT(OptionError("spp: [1, 2\n"), HasSubstr("job.yaml:"));
  EXPECT_THAT(OptionError("? [a]\n: 1\n"), HasSubstr("expected the name of an option"));
  EXPECT_THAT(OptionError("profiles: 3\n", OptionFileKind::kConfiguration),
              HasSubstr("expected a map of names"));
}

TEST(OptionFile, IsBounded) {
  const ScratchFolder folder;
  EXPECT_TRUE(absl::IsNotFound(ReadOptionFile(folder.File("none.yaml"), OptionFileKind::kJob).status()));
  const std::string large = folder.Write("large.yaml", std::string((1 << 20) + 1, ' '));
  EXPECT_TRUE(absl::IsInvalidArgument(ReadOptionFile(large, OptionFileKind::kJob).status()));
  EXPECT_TRUE(ReadOptionFile(folder.Write("empty.yaml", ""), OptionFileKind::kJob)->options.empty());
  EXPECT_FALSE(Parse(std::string(100'000, '[')).ok()) << "does not go as deep as the text asks";
}

}  // namespace
}  // namespace lumifold::client
