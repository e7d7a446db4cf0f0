#include "proto/logging/nonblocking_log.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>
#include <unistd.h>

#include <cstdio>
#include <string>
#include <utility>
#include <vector>

namespace lumifold::logging {
namespace {

/// A pipe that nobody reads until the test does. It stays open: a thread of an ended log may still wait for
/// it, and must not meet the pipe of another test under the same number.
class NonblockingLogTest : public testing::Test {
 protected:
  NonblockingLogTest() {
    EXPECT_EQ(pipe2(pipe_, O_CLOEXEC), 0);
    fcntl(pipe_[1], F_SETPIPE_SZ, 4096);
  }
  std::shared_ptr<spdlog::logger> Log(size_t max_waiting_bytes) {
    return MakeNonblockingLogger(
        {.name = "test", .pattern = "%l %v", .file = pipe_[1], .max_waiting_bytes = max_waiting_bytes});
  }

  /// Reads until a line satisfies the condition.
  template <typename Condition>
  std::vector<std::string> ReadUntil(const Condition& condition) {
    std::string text;
    char byte = 0;
    std::vector<std::string> lines;
    while (read(pipe_[0], &byte, 1) == 1) {
      if (byte != '\n') {
        text += byte;
        continue;
      }
      lines.push_back(std::exchange(text, {}));
      if (condition(lines.back())) return lines;
    }
    ADD_FAILURE() << "the pipe ended";
    return lines;
  }

  int pipe_[2] = {-1, -1};
};

TEST_F(NonblockingLogTest, WritesLinesInOrder) {
  const auto log = Log(kMaxWaitingLogBytes);
  log->info("event=first");
  log->error("event=second");
  log->debug("event=hidden");
  log->warn("event=third");
  const auto is_third = [](const std::string& line) { return line == "warning event=third"; };
  EXPECT_THAT(ReadUntil(is_third),
              testing::ElementsAre("info event=first", "error event=second", "warning event=third"));
}

TEST_F(NonblockingLogTest, NeverWaitsForTheReaderAndCountsWhatItDrops) {
  const auto log = Log(10'000);
  constexpr int kLines = 20'000;  // the test ends only if none of them waits for the pipe
  for (int i = 0; i < kLines; ++i) log->info("event=line number={:06}", i);
  int accounted = 0;
  int dropped = 0;
  const std::vector<std::string> lines = ReadUntil([&](const std::string& line) {
    int more = 1;
    if (sscanf(line.c_str(), "warning event=log_dropped lines=%d", &more) == 1) dropped += more;
    accounted += more;
    return accounted >= kLines;
  });
  EXPECT_EQ(accounted, kLines);
  EXPECT_GT(dropped, 0);
  EXPECT_EQ(lines[0], "info event=line number=000000");
  log->info("event=after");
  EXPECT_EQ(ReadUntil([](const std::string&) { return true; }).back(), "info event=after");
}

TEST_F(NonblockingLogTest, EndsThoughNobodyReads) {
  const auto log = Log(kMaxWaitingLogBytes);
  for (int i = 0; i < 1000; ++i) log->info("event=line number={}", i);
}

TEST_F(NonblockingLogTest, CutsALineThatIsTooLong) {
  const auto log = Log(kMaxWaitingLogBytes);
  log->info("event=long text={}", std::string(1'000'000, 'x'));
  log->info("event=after");
  const std::vector<std::string> lines =
      ReadUntil([](const std::string& line) { return line == "info event=after"; });
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0].size() + 1, kMaxLogLineBytes);
  EXPECT_THAT(lines[0], testing::AllOf(testing::StartsWith("info event=long text=xxx"),
                                       testing::EndsWith("... (cut)")));
}

TEST_F(NonblockingLogTest, WritesTheRestAtItsEnd) {
  Log(kMaxWaitingLogBytes)->info("event=last");
  EXPECT_EQ(ReadUntil([](const std::string&) { return true; }).back(), "info event=last");
}

}  // namespace
}  // namespace lumifold::logging
