#include "proto/logging/line_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "proto/threads/event.h"

namespace lumifold::logging {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

constexpr LineWriter::Options kPatient = {.max_waiting_bytes = 20, .flush_time = absl::Minutes(5)};

/// What a file got, which outlives it.
struct Written {
  void Add(std::string_view lines, uint64_t dropped) ABSL_LOCKS_EXCLUDED(mutex) {
    absl::MutexLock lock(&mutex);
    batches.emplace_back(lines, dropped);
  }
  std::vector<std::pair<std::string, uint64_t>> Batches() ABSL_LOCKS_EXCLUDED(mutex) {
    absl::MutexLock lock(&mutex);
    return batches;
  }

  absl::Mutex mutex;
  std::vector<std::pair<std::string, uint64_t>> batches ABSL_GUARDED_BY(mutex);
  threads::Event begun;    // the first write
  threads::Event may_end;  // the first write hangs until then
  threads::Event closed;
};

class HangingFile final : public LineWriter::File {
 public:
  explicit HangingFile(std::shared_ptr<Written> written) : written_(std::move(written)) {}
  ~HangingFile() override { written_->closed.Notify(); }

  void Write(std::string_view lines, uint64_t dropped) override {
    written_->begun.Notify();
    EXPECT_TRUE(written_->may_end.WaitFor(absl::Minutes(5)));
    written_->Add(lines, dropped);
  }

 private:
  const std::shared_ptr<Written> written_;
};

TEST(LineWriter, DropsAndCountsWhatDoesNotFitAndAllThatFollowsIt) {
  const auto written = std::make_shared<Written>();
  {
    LineWriter writer(kPatient, std::make_unique<HangingFile>(written));
    writer.Add("first\n");
    ASSERT_TRUE(written->begun.WaitFor(absl::Minutes(5)));
    writer.Add("123456789\n");
    writer.Add("12345678901234567890\n");
    writer.Add("fits\n");  // it would be before a line that came earlier
    EXPECT_THAT(written->Batches(), IsEmpty());
    written->may_end.Notify();
  }
  EXPECT_THAT(written->Batches(), ElementsAre(Pair("first\n", 0), Pair("123456789\n", 2)));
}

TEST(LineWriter, TakesLinesAgainOnceTheFileHasTakenWhatWaited) {
  const auto written = std::make_shared<Written>();
  written->may_end.Notify();
  {
    LineWriter writer(kPatient, std::make_unique<HangingFile>(written));
    writer.Add(std::string(100, 'x'));
    while (written->Batches().empty()) continue;
    writer.Add("after\n");
  }
  EXPECT_THAT(written->Batches(), ElementsAre(Pair("", 1), Pair("after\n", 0)));
  EXPECT_TRUE(written->closed.WaitFor(absl::Minutes(5)));
}

TEST(LineWriter, EndsThoughAWriteHangs) {
  const auto written = std::make_shared<Written>();
  const auto start = std::chrono::steady_clock::now();
  {
    LineWriter writer({.max_waiting_bytes = 20, .flush_time = absl::Milliseconds(10)},
                      std::make_unique<HangingFile>(written));
    writer.Add("line\n");
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::minutes(1)) << "10 were milliseconds";
  EXPECT_THAT(written->Batches(), IsEmpty());
  written->may_end.Notify();
  EXPECT_TRUE(written->closed.WaitFor(absl::Minutes(5)));
  EXPECT_THAT(written->Batches(), ElementsAre(Pair("line\n", 0)));
}

}  // namespace
}  // namespace lumifold::logging
