#include "proto/logging/json_formatter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "proto/logging/fields.h"
#include "tests/support/hostile_text.h"

namespace lumifold::logging {
namespace {

constexpr size_t kMaxBytes = 4096;

std::string Json(const std::string& line, size_t max_bytes = kMaxBytes) {
  const absl::Time time = absl::FromUnixMicros(1'790'000'000'000'007);
  return JsonLine(absl::ToChronoTime(time), "warn", line, max_bytes);
}

TEST(JsonLine, HasTimeLevelEventAndFieldsInTheirOrder) {
  EXPECT_EQ(Json(R"(event=unit_failed unit="j-1 frame 0" seconds=0.250 error="a \"b\"" free text)"),
            R"({"time":"2026-09-21T14:13:20.000007Z","level":"warn","event":"unit_failed","msg":"free text",)"
            R"("unit":"j-1 frame 0","seconds":"0.250","error":"a \"b\""})"
            "\n");
}

TEST(JsonLine, NumbersNamesThatRepeat) {
  EXPECT_THAT(Json("event=e error=1 error=2 time=3 event=4"),
              testing::HasSubstr(R"("event":"e","error":"1","error_2":"2","time_2":"3","event_2":"4"})"));
}

/// What a program reads of a value: bytes that are no UTF-8 are replaced.
std::string Readable(const std::string& value) {
  const std::string text =
      nlohmann::json(value).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return nlohmann::json::parse(text);
}

TEST(JsonLine, IsAnObjectInOneLineThatGivesBackAnyValue) {
  std::mt19937 random(1);
  int exact = 0;
  for (int run = 0; run < 20'000; ++run) {
    const std::string error = HostileText(random);
    const std::string name = HostileText(random);
    const std::string line = Json(absl::StrCat("event=e error=", Escaped(error), " name=", Escaped(name)));
    ASSERT_EQ(line.find('\n'), line.size() - 1) << line;
    const nlohmann::json json = nlohmann::json::parse(line);
    ASSERT_EQ(json.size(), 5u) << line;
    ASSERT_EQ(json["error"], Readable(error));
    ASSERT_EQ(json["name"], Readable(name));
    exact += json["error"] == error ? 1 : 0;
  }
  EXPECT_GT(exact, 1000);
}

TEST(JsonLine, IsAnObjectOfAnyBytesWithinItsLimit) {
  std::mt19937 random(2);
  int cut = 0;
  for (int run = 0; run < 5'000; ++run) {
    std::string bytes = "event=e first=1 ";
    for (auto n = random() % 100; n > 0; --n) absl::StrAppend(&bytes, HostileText(random));
    const std::string line = Json(bytes, 1024);
    ASSERT_LE(line.size(), 1024u);
    const nlohmann::json json = nlohmann::json::parse(line);
    ASSERT_EQ(json["event"], "e");
    cut += json.contains("cut") ? 1 : 0;
  }
  EXPECT_GT(cut, 1000);
}

TEST(JsonLine, KeepsTheOtherFieldsWhereAValueIsCut) {
  const nlohmann::json json = nlohmann::json::parse(
      Json("event=e error=" + Escaped(std::string(100'000, '"')) + " job=j-1 trace=abc"));
  EXPECT_EQ(json["error"], std::string(256, '"'));
  EXPECT_EQ(json["job"], "j-1");
  EXPECT_EQ(json["trace"], "abc");
  EXPECT_EQ(json["cut"], "true");
}

}  // namespace
}  // namespace lumifold::logging
