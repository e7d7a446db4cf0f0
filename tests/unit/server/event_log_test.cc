#include "server/coordinator/event_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "proto/logging/fields.h"
#include "tests/unit/server/coordinator_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

std::vector<std::string> Texts(const std::vector<v1::LogEvent>& events) {
  std::vector<std::string> texts;
  texts.reserve(events.size());
  for (const v1::LogEvent& event : events) texts.push_back(event.text());
  return texts;
}

void Add(EventLog* log, int unix_ms, const std::string& line) {
  log->Add({.time = absl::ToChronoTime(absl::FromUnixMillis(unix_ms)),
            .level = "info",
            .text = line,
            .parsed = logging::ParseLine(line)});
}

TEST(EventLog, FindsLinesByJobAndByWorker) {
  EventLog log;
  const std::string submitted = R"(event=job_submitted job=j-1 scene="a b.glb" size=8x8)";
  const std::string failed = R"(event=unit_failed unit="j-1 frame 0 tile 3" worker=w-7/node:1 error="x")";
  const std::string gone = "event=worker_gone worker=w-7/node:1";
  const std::string again = "event=worker_connected worker=w-8/node:1 class=\"c\"";
  for (const std::string& line : {submitted, failed, gone, again}) Add(&log, 5, line);
  Add(&log, 5, "event=listening address=127.0.0.1:1");
  EXPECT_THAT(Texts(log.OfJob("j-1", 100)), ElementsAre(submitted, failed));
  EXPECT_THAT(Texts(log.OfWorker("w-7", 100)), ElementsAre(failed, gone));
  EXPECT_THAT(Texts(log.OfWorker("node:1", 100)), ElementsAre(failed, gone, again));
  EXPECT_THAT(Texts(log.OfWorker("node:1", 2)), ElementsAre(gone, again));
  EXPECT_THAT(log.OfJob("", 100), IsEmpty());
  EXPECT_THAT(log.OfWorker("listening", 100), IsEmpty());
  EXPECT_EQ(log.OfJob("j-1", 1)[0].unix_ms(), 5);
}

TEST(EventLog, TextOfOthersIsNoField) {
  EventLog log;
  Add(&log, 0, R"(event=unit_failed unit="j-1 frame 0" error="a \" job=j-2 worker=w-1 ")");
  EXPECT_EQ(log.OfJob("j-1", 9).size(), 1u);
  EXPECT_THAT(log.OfJob("j-2", 9), IsEmpty());
  EXPECT_THAT(log.OfWorker("w-1", 9), IsEmpty());
}

TEST(EventLog, DropsTheOldestOverItsLimits) {
  EventLog few(/*max_events=*/3);
  for (int i = 0; i < 5; ++i) Add(&few, i, absl::StrCat("event=e", i, " job=j"));
  EXPECT_THAT(Texts(few.OfJob("j", 9)), ElementsAre("event=e2 job=j", "event=e3 job=j", "event=e4 job=j"));
  EventLog small(/*max_events=*/1000, /*max_bytes=*/100);
  for (int i = 0; i < 9; ++i)
    Add(&small, i, absl::StrCat("event=e", i, " job=j text=", std::string(25, 'x')));
  EXPECT_EQ(small.OfJob("j", 9).size(), 2u);
  Add(&small, 0, "event=long job=j " + std::string(200, 'x'));
  EXPECT_THAT(small.OfJob("j", 9), IsEmpty()) << "a line over the limit is not kept either";
}

/// Lines that a worker sends, one millisecond after the other.
google::protobuf::RepeatedPtrField<v1::LogEvent> Sent(int64_t unix_ms,
                                                      const std::vector<std::string>& texts) {
  google::protobuf::RepeatedPtrField<v1::LogEvent> lines;
  for (const std::string& text : texts) {
    v1::LogEvent* line = lines.Add();
    line->set_unix_ms(unix_ms++);
    line->set_level("warn");
    line->set_text(text);
  }
  return lines;
}
bool IsKnown(const std::string& job) { return job == "j-1"; }
const absl::Time kLater = absl::FromUnixSeconds(1'000);

TEST(EventLog, LinesOfWorkersAreAmongTheOthersByTime) {
  EventLog log;
  Add(&log, 5, "event=before job=j-1");
  Add(&log, 8, "event=after job=j-1 worker=w-7/node:1");
  log.AddOfWorker("w-7/node:1", Sent(6, {"event=own job=j-1", "event=other job=j-2"}), kLater, IsKnown);
  EXPECT_THAT(Texts(log.OfJob("j-1", 9)), ElementsAre("event=before job=j-1", "event=own job=j-1",
                                                      "event=after job=j-1 worker=w-7/node:1"));
  EXPECT_EQ(log.OfJob("j-1", 9)[1].worker(), "w-7/node:1");
  EXPECT_THAT(Texts(log.OfJob("j-1", 2)),
              ElementsAre("event=own job=j-1", "event=after job=j-1 worker=w-7/node:1"));
  EXPECT_THAT(log.OfJob("j-2", 9), IsEmpty()) << "it never had that job";
  for (const char* name : {"w-7", "node:1"}) EXPECT_EQ(log.OfWorker(name, 9).size(), 3u);
}

TEST(EventLog, WhatAWorkerSaysOfTimeAndLevelIsBounded) {
  EventLog log;
  google::protobuf::RepeatedPtrField<v1::LogEvent> lines = Sent(0, {"event=a", "event=b"});
  lines[0].set_unix_ms(INT64_MAX);
  lines[0].set_level("shout");
  lines[1].set_unix_ms(INT64_MIN);
  log.AddOfWorker("w-7/x", lines, kLater, IsKnown);
  const std::vector<v1::LogEvent> kept = log.OfWorker("w-7", 9);
  ASSERT_EQ(kept.size(), 2u);
  EXPECT_EQ(kept[0].unix_ms(), 0);
  EXPECT_EQ(kept[1].unix_ms(), 1'000'000);
  EXPECT_EQ(kept[1].level(), "info");
}

TEST(EventLog, AWorkerThatWritesMuchPushesOutItsOwnLinesAlone) {
  EventLog log;
  log.AddOfWorker("w-1/a", Sent(0, {"event=quiet"}), kLater, IsKnown);
  for (int i = 0; i < 100; ++i) {
    log.AddOfWorker("w-2/b", Sent(i, {absl::StrCat("event=short n=", i)}), kLater, IsKnown);
    log.AddOfWorker("w-3/c", Sent(i, {"event=long " + std::string(100'000, 'x')}), kLater, IsKnown);
  }
  EXPECT_EQ(log.OfWorker("w-1", 1000).size(), 1u);
  EXPECT_EQ(log.OfWorker("w-2", 1000).size(), kMaxWorkerLines);
  EXPECT_EQ(log.OfWorker("w-2", 1000).back().text(), "event=short n=99");
  EXPECT_LT(log.OfWorker("w-3", 1000).size(), kMaxWorkerLines);
  EXPECT_GT(log.OfWorker("w-3", 1000).size(), 5u);
}

TEST(EventLog, OfTooManyWorkersTheOneThatWasSilentForLongestIsDropped) {
  EventLog log;
  const auto say = [&](const std::string& worker) {
    log.AddOfWorker(worker, Sent(0, {"event=a"}), kLater, IsKnown);
  };
  say("first/a");
  say("second/a");
  for (size_t i = 3; i <= kMaxLoggedWorkers; ++i) say(absl::StrCat("w-", i, "/a"));
  say("first/a");
  say("last/a");
  EXPECT_EQ(log.OfWorker("first", 9).size(), 2u);
  EXPECT_THAT(log.OfWorker("second", 9), IsEmpty());
  EXPECT_EQ(log.OfWorker("last", 9).size(), 1u);
}

TEST(EventLog, TheLoggerKeepsLinesFromInfoOn) {
  std::ostringstream text;
  const auto other =
      std::make_shared<spdlog::logger>("x", std::make_shared<spdlog::sinks::ostream_sink_mt>(text));
  other->set_level(spdlog::level::debug);
  EventLog events;
  const std::shared_ptr<spdlog::logger> log = MakeEventLogger(other, nullptr, &events);
  log->debug("event=one job=j");
  log->info("event=two job=j");
  log->error("event=three job=j");
  EXPECT_THAT(Texts(events.OfJob("j", 9)), ElementsAre("event=two job=j", "event=three job=j"));
  EXPECT_EQ(events.OfJob("j", 9)[1].level(), "error");
  EXPECT_THAT(text.str(), HasSubstr("event=one"));
}

class EventLogTest : public CoordinatorFixture {};

TEST_F(EventLogTest, OfTooManyLongLinesTheNewestThatFitAMessageAreAnswered) {
  EventLog log;
  options_.job_log.events = &log;
  ASSERT_TRUE(Start().ok());
  constexpr size_t kLines = 900;
  const std::string text(8192, 'x');
  for (size_t i = 0; i < kLines; ++i) Add(&log, 0, absl::StrCat("event=e", i, " job=j ", text));
  v1::GetLogRequest request;
  request.set_job_id("j");
  request.set_limit(kLines);
  const absl::StatusOr<v1::GetLogResponse> response = coordinator_->jobs().GetLog(request);
  ASSERT_TRUE(response.ok()) << response.status();
  const auto count = static_cast<size_t>(response->events_size());
  EXPECT_NEAR(static_cast<double>(count * text.size()), 3 << 20, 1 << 16);
  for (size_t i = 0; i < count; ++i) {
    EXPECT_THAT(response->events(static_cast<int>(i)).text(),
                StartsWith(absl::StrCat("event=e", kLines - count + i, " ")));
  }
  Stop();
}

}  // namespace
}  // namespace lumifold::server
