#include "proto/logging/fields.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/support/hostile_text.h"

namespace lumifold::logging {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

TEST(ParseLine, TakesEventFieldsAndFreeText) {
  const Line line = ParseLine(R"(event=unit_failed unit="j-1 frame 0" worker=w-7/node:1 n=3 two words)");
  EXPECT_EQ(line.event, "unit_failed");
  EXPECT_THAT(line.fields,
              ElementsAre(Pair("unit", "j-1 frame 0"), Pair("worker", "w-7/node:1"), Pair("n", "3")));
  EXPECT_EQ(line.text, "two words");
  EXPECT_EQ(line.Get("worker"), "w-7/node:1");
  EXPECT_EQ(line.Get("text"), "");
}

TEST(ParseLine, TakesWhatIsNoFieldAsText) {
  const Line line = ParseLine("--no-sandbox: =x a-b=c  1 = 2 ");
  EXPECT_EQ(line.event, "");
  EXPECT_THAT(line.fields, IsEmpty());
  EXPECT_EQ(line.text, "--no-sandbox: =x a-b=c 1 = 2");
}

TEST(ParseLine, EndsAQuoteThatIsMissingWithTheLine) {
  EXPECT_THAT(ParseLine(R"(a="b c)").fields, ElementsAre(Pair("a", "b c")));
  EXPECT_THAT(ParseLine(R"(a="b \)").fields, ElementsAre(Pair("a", R"(b \)")));
  EXPECT_THAT(ParseLine("a=").fields, ElementsAre(Pair("a", "")));
  EXPECT_THAT(ParseLine("a=\"").fields, ElementsAre(Pair("a", "")));
}

TEST(ParseLine, LeavesEscapesThatAreNoneAsTheyAre) {
  EXPECT_THAT(ParseLine(R"(a="C:\q" b=\x20)").fields,
              ElementsAre(Pair("a", R"(C:\q)"), Pair("b", R"(\x20)")));
}

TEST(ParseLine, GivesBackAnyValues) {
  std::mt19937 random(1);
  for (int run = 0; run < 20'000; ++run) {
    std::string line = "event=run";
    std::vector<std::pair<std::string, std::string>> fields;
    for (auto n = random() % 5; n > 0; --n) {
      fields.emplace_back(absl::StrCat("field_", random() % 3), HostileText(random));
      absl::StrAppend(&line, " ", fields.back().first, "=", Escaped(fields.back().second));
    }
    const Line parsed = ParseLine(line);
    ASSERT_EQ(parsed.event, "run");
    ASSERT_EQ(parsed.fields, fields) << line;
    ASSERT_EQ(parsed.text, "");
  }
}

TEST(ParseLine, TakesAnyBytes) {
  std::mt19937 random(2);
  for (int run = 0; run < 20'000; ++run) {
    const std::string bytes = HostileText(random);
    const Line line = ParseLine(bytes);
    size_t found = line.event.size() + line.text.size();
    for (const auto& [name, value] : line.fields) found += name.size() + value.size();
    ASSERT_LE(found, bytes.size());
  }
}

TEST(Quoted, IsOneFieldOfOneLineWhateverItSays) {
  std::mt19937 random(3);
  for (int run = 0; run < 5'000; ++run) {
    const std::string line = "error=" + Quoted(HostileText(random)) + " last=1";
    ASSERT_EQ(line.find_first_of(std::string("\n\r\0\x1b", 4)), std::string::npos);
    const Line parsed = ParseLine(line);
    ASSERT_EQ(parsed.fields.size(), 2u) << line;
    ASSERT_EQ(parsed.Get("last"), "1");
  }
}

TEST(EventOf, IsTheFirstField) {
  EXPECT_EQ(EventOf("event=a b=c"), "a");
  EXPECT_EQ(EventOf("event=a"), "a");
  EXPECT_EQ(EventOf("b=c event=a"), "");
  EXPECT_EQ(EventOf(""), "");
}

}  // namespace
}  // namespace lumifold::logging
