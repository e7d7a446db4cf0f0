#include "proto/logging/front_logger.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/ostream_sink.h>

#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "proto/logging/fields.h"
#include "proto/logging/job_labels.h"

namespace lumifold::logging {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class FrontLoggerTest : public testing::Test {
 protected:
  FrontLoggerTest() {
    log_->set_pattern("%l %v");
    log_->set_level(spdlog::level::warn);
    options_.keep = [this](const PassedLine& line) {
      kept_.push_back(std::string(line.level) + " " + std::string(line.text) + " / " + line.parsed.event);
    };
  }

  std::vector<std::string> Written() const { return absl::StrSplit(text_.str(), '\n', absl::SkipEmpty()); }

  std::ostringstream text_;
  std::shared_ptr<spdlog::logger> log_ =
      std::make_shared<spdlog::logger>("x", std::make_shared<spdlog::sinks::ostream_sink_mt>(text_));
  FrontOptions options_ = {.log = log_};
  std::vector<std::string> kept_;
};

TEST_F(FrontLoggerTest, PassesLinesOnAtTheLevelOfTheOther) {
  const auto log = MakeFrontLogger(options_);
  log->debug("event=one");
  log->info("event=two");
  log->error("event=three");
  EXPECT_THAT(Written(), ElementsAre("error event=three"));
  EXPECT_THAT(kept_, ElementsAre("info event=two / two", "error event=three / three"));
}

TEST_F(FrontLoggerTest, KeepsDebugWhereItIsWritten) {
  log_->set_level(spdlog::level::debug);
  MakeFrontLogger(options_)->debug("event=one");
  EXPECT_THAT(Written(), ElementsAre("debug event=one"));
  EXPECT_THAT(kept_, ElementsAre("debug event=one / one"));
}

TEST_F(FrontLoggerTest, WritesNothingOfALogThatIsOff) {
  log_->set_level(spdlog::level::off);
  MakeFrontLogger(options_)->error("event=one");
  EXPECT_THAT(Written(), IsEmpty());
  EXPECT_THAT(kept_, ElementsAre("error event=one / one"));
}

TEST_F(FrontLoggerTest, LabelsLinesAboutAJob) {
  options_.labels = std::make_shared<JobLabels>();
  options_.labels->Set("j-1", {.trace = "abc", .user = "ann"});
  const auto log = MakeFrontLogger(options_);
  log->error("event=a job=j-1");
  log->error("event=b unit=\"j-1 frame 0\" worker=w-1");
  log->error("event=c job=j-2");
  log->error("event=d");
  EXPECT_THAT(Written(),
              ElementsAre("error event=a job=j-1 user=\"ann\" trace=abc",
                          "error event=b unit=\"j-1 frame 0\" worker=w-1 job=j-1 user=\"ann\" trace=abc",
                          "error event=c job=j-2", "error event=d"));
}

TEST_F(FrontLoggerTest, NamesTheWorkerWhoseLogItIs) {
  options_.labels = std::make_shared<JobLabels>();
  options_.labels->Set("j-1", {.trace = "abc"});
  options_.labels->SetWorker("w-7/node");
  const auto log = MakeFrontLogger(options_);
  log->error("event=a job=j-1");
  log->error("event=b worker=w-8");
  EXPECT_THAT(Written(),
              ElementsAre("error event=a job=j-1 worker=w-7/node trace=abc", "error event=b worker=w-8"));
}

TEST_F(FrontLoggerTest, SaysHowManyLinesItHasDropped) {
  options_.limits.lines = 2;
  {
    const auto log = MakeFrontLogger(options_);
    for (int i = 0; i < 5; ++i) log->error("event=flood n={}", i);
    log->error("event=other");
  }
  EXPECT_THAT(Written(), ElementsAre("error event=flood n=0", "error event=flood n=1", "error event=other",
                                     "warning event=lines_dropped of=flood count=3"));
  EXPECT_EQ(kept_.size(), 4u) << "what is kept has the same lines";
}

}  // namespace
}  // namespace lumifold::logging
