#include "client/cli/progress.h"

#include <gtest/gtest.h>

#include <sstream>

#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

ProgressState Rendering(int64_t done, int64_t total, int workers = 0) {
  ProgressState state;
  state.stage = "rendering";
  state.done = done;
  state.total = total;
  state.workers = workers;
  return state;
}

class ProgressPrinterTest : public testing::Test {
 protected:
  ProgressPrinter Printer(bool terminal, int columns = 80) {
    return {out_, {.terminal = terminal, .columns = columns, .now = [this] { return time_.now; }}};
  }
  // Text printed since the last call.
  std::string Printed() {
    std::string text = out_.str();
    out_.str("");
    return text;
  }

  FakeTime time_;
  std::ostringstream out_;
};

TEST(DurationText, PicksTheUnitsPeopleRead) {
  EXPECT_EQ(DurationText(absl::ZeroDuration()), "0s");
  EXPECT_EQ(DurationText(absl::Milliseconds(1)), "1s");
  EXPECT_EQ(DurationText(absl::Seconds(59)), "59s");
  EXPECT_EQ(DurationText(absl::Seconds(65)), "1m05s");
  EXPECT_EQ(DurationText(absl::Minutes(123)), "2h03m");
  EXPECT_EQ(DurationText(absl::Seconds(-5)), "0s");
}

TEST(RateText, PicksThePrefix) {
  EXPECT_EQ(RateText(12'345'678, ProgressUnit::kSamples), "12.3 Msamples/s");
  EXPECT_EQ(RateText(640'000, ProgressUnit::kSamples), "640 ksamples/s");
  EXPECT_EQ(RateText(12, ProgressUnit::kSamples), "12 samples/s");
  EXPECT_EQ(RateText(1'500'000, ProgressUnit::kBytes), "1.5 MB/s");
}

TEST(RateMeter, KnowsNothingUntilSomethingMoves) {
  RateMeter rate;
  EXPECT_FALSE(rate.PerSecond().has_value());
  rate.Add(absl::UnixEpoch(), 100);
  EXPECT_FALSE(rate.PerSecond().has_value());
  rate.Add(absl::UnixEpoch() + absl::Seconds(1), 100);
  EXPECT_FALSE(rate.PerSecond().has_value());
}

TEST(RateMeter, DoesNotCountWhatWasDoneBeforeItLooked) {
  RateMeter rate;
  rate.Add(absl::UnixEpoch(), 1'000'000);
  rate.Add(absl::UnixEpoch() + absl::Seconds(2), 1'000'100);
  EXPECT_DOUBLE_EQ(rate.PerSecond().value(), 50);
}

TEST(RateMeter, ForgetsWhatIsLongAgo) {
  RateMeter rate;
  for (int second = 0; second <= 100; ++second) {
    rate.Add(absl::UnixEpoch() + absl::Seconds(second),
             second <= 50 ? 1000 * second : 50'000 + 10 * (second - 50));
  }
  EXPECT_DOUBLE_EQ(rate.PerSecond().value(), 10);
}

TEST(RateMeter, BeginsAnewWhenTheAmountFalls) {
  RateMeter rate;
  rate.Add(absl::UnixEpoch(), 500);
  rate.Add(absl::UnixEpoch() + absl::Seconds(1), 0);
  rate.Add(absl::UnixEpoch() + absl::Seconds(2), 7);
  EXPECT_DOUBLE_EQ(rate.PerSecond().value(), 7);
}

TEST_F(ProgressPrinterTest, RewritesOneLineOnATerminal) {
  ProgressPrinter printer = Printer(true, 80);
  printer.Update(Rendering(0, 1000, 2));
  EXPECT_EQ(Printed(), "\rrendering  [                ]   0%  2 workers");
  time_.now += absl::Seconds(1);
  printer.Update(Rendering(500, 1000, 2));
  EXPECT_EQ(Printed(), "\rrendering  [========        ]  50%  500 samples/s, 1s left, 2 workers");
}

TEST_F(ProgressPrinterTest, LetsNoBarGrowBeyondMeasure) {
  ProgressPrinter printer = Printer(true, 300);
  printer.Update(Rendering(1000, 1000));
  EXPECT_EQ(Printed(), "\rrendering  [" + std::string(30, '=') + "] 100%");
}

TEST_F(ProgressPrinterTest, LeavesTheBarOutWhereTheTerminalIsNarrow) {
  ProgressPrinter printer = Printer(true, 30);
  printer.Update(Rendering(250, 1000, 2));
  EXPECT_EQ(Printed(), "\rrendering  25%  2 workers");
}

TEST_F(ProgressPrinterTest, NeverFillsTheTerminalToItsEdge) {
  ProgressPrinter printer = Printer(true, 12);
  printer.Update(Rendering(250, 1000, 2));
  EXPECT_EQ(Printed(), "\rrendering  ");
}

TEST_F(ProgressPrinterTest, ClearsALineThatWasLonger) {
  ProgressPrinter printer = Printer(true);
  ProgressState state;
  state.stage = "downloading";
  printer.Update(state);
  Printed();
  state.stage = "done";
  printer.Update(state);
  EXPECT_EQ(Printed(), "\rdone       \b\b\b\b\b\b\b");
}

TEST_F(ProgressPrinterTest, PutsWordsOnALineOfTheirOwn) {
  ProgressPrinter printer = Printer(true);
  ProgressState state;
  state.stage = "queued";
  printer.Update(state);
  Printed();
  printer.Message("warning: no light");
  EXPECT_EQ(Printed(), "\r      \rwarning: no light\n");
}

TEST_F(ProgressPrinterTest, ShowsLinesBelowAndRemovesThem) {
  ProgressPrinter printer = Printer(true, 20);
  ProgressState state;
  state.stage = "running";
  state.lines = {"a:1  2 of 2 units and more", "b:2"};
  printer.Update(state);
  EXPECT_EQ(Printed(), "\rrunning\n  a:1  2 of 2 units\n  b:2");
  time_.now += absl::Seconds(1);
  printer.Update(state);
  EXPECT_EQ(Printed(), "") << "nothing has changed";
  state.lines = {"b:2"};
  time_.now += absl::Seconds(1);
  printer.Update(state);
  const std::string back_to_the_first = "\r\x1b[J\x1b[A\x1b[K\x1b[A\x1b[K\r       \r";
  EXPECT_EQ(Printed(), back_to_the_first + "\rrunning\n  b:2");
  printer.Message("warning: no light");
  EXPECT_EQ(Printed(), "\r\x1b[J\x1b[A\x1b[K\r       \rwarning: no light\n");
}

TEST_F(ProgressPrinterTest, PrintsLinesBelowElsewhereToo) {
  ProgressPrinter printer = Printer(false);
  ProgressState state = Rendering(0, 1000);
  state.lines = {"a:1  2 of 2 units"};
  printer.Update(state);
  EXPECT_EQ(Printed(), "rendering 0%\n  a:1  2 of 2 units\n");
}

TEST_F(ProgressPrinterTest, LeavesNothingOnTheTerminal) {
  {
    ProgressPrinter printer = Printer(true);
    printer.Update(Rendering(0, 0));
    Printed();
  }
  EXPECT_EQ(Printed(), "\r         \r");
}

TEST_F(ProgressPrinterTest, PrintsPlainLinesEachTenthElsewhere) {
  ProgressPrinter printer = Printer(false);
  for (int i = 0; i <= 1000; ++i) {
    printer.Update(Rendering(i, 1000));
    time_.now += absl::Milliseconds(100);
  }
  EXPECT_EQ(Printed(),
            "rendering 0%\n"
            "rendering 10% (10 samples/s, 1m30s left)\n"
            "rendering 20% (10 samples/s, 1m20s left)\n"
            "rendering 30% (10 samples/s, 1m10s left)\n"
            "rendering 40% (10 samples/s, 1m00s left)\n"
            "rendering 50% (10 samples/s, 50s left)\n"
            "rendering 60% (10 samples/s, 40s left)\n"
            "rendering 70% (10 samples/s, 30s left)\n"
            "rendering 80% (10 samples/s, 20s left)\n"
            "rendering 90% (10 samples/s, 10s left)\n"
            "rendering 100% (10 samples/s)\n");
}

TEST_F(ProgressPrinterTest, PrintsNoMoreThanALineEveryThreeSeconds) {
  ProgressPrinter printer = Printer(false);
  for (int i = 0; i <= 100; ++i) {
    printer.Update(Rendering(i, 100));
    time_.now += absl::Milliseconds(40);
  }
  EXPECT_EQ(Printed(), "rendering 0%\nrendering 75% (25 samples/s, 1s left)\n");
}

TEST_F(ProgressPrinterTest, ShowsLifeWhereATenthTakesLong) {
  ProgressPrinter printer = Printer(false);
  printer.Update(Rendering(0, 1'000'000));
  time_.now += absl::Seconds(31);
  printer.Update(Rendering(31, 1'000'000));
  EXPECT_EQ(Printed(), "rendering 0%\nrendering 0% (1 samples/s, 277h46m left)\n");
}

}  // namespace
}  // namespace lumifold::client
