#include "worker/leases/worker_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/rpc/limits.h"
#include "tests/unit/worker/worker_rig.h"

namespace lumifold::worker {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr char kTrace[] = "4bf92f3577b34da6a3ce929d0e0e4736";

template <typename Events>
std::vector<std::string> Texts(const Events& events) {
  std::vector<std::string> texts;
  texts.reserve(static_cast<size_t>(events.size()));
  for (const v1::LogEvent& event : events) texts.push_back(absl::StrCat(event.level(), " ", event.text()));
  return texts;
}

/// A log at this level that writes nothing.
WorkerLog Log(spdlog::level::level_enum level) {
  auto log = std::make_shared<spdlog::logger>("x");
  log->set_level(level);
  return MakeWorkerLog(log);
}

TEST(LogTail, HasTheLinesSinceItWasTaken) {
  const WorkerLog log = Log(spdlog::level::warn);
  log.log->debug("event=a");
  log.log->info("event=b");
  log.log->error("event=c");
  EXPECT_THAT(Texts(log.tail->Take()), ElementsAre("info event=b", "error event=c"));
  EXPECT_THAT(log.tail->Take(), IsEmpty());
  log.log->info("event=d");
  EXPECT_THAT(Texts(log.tail->Take()), ElementsAre("info event=d"));
}

TEST(LogTail, HasDebugLinesWhereTheyAreWritten) {
  const WorkerLog log = Log(spdlog::level::debug);
  log.log->debug("event=a");
  EXPECT_THAT(Texts(log.tail->Take()), ElementsAre("debug event=a"));
}

TEST(LogTail, KeepsTheLastLinesAndCutsLongOnes) {
  const WorkerLog log = Log(spdlog::level::info);
  for (int i = 0; i < 50; ++i) log.log->info("event=e n={} text={}", i, std::string(5000, 'x'));
  const std::vector<v1::LogEvent> lines = log.tail->Take();
  ASSERT_EQ(lines.size(), rpc::kMaxTailLines);
  EXPECT_THAT(lines.back().text(), HasSubstr("n=49 "));
  EXPECT_LE(lines.back().text().size(), rpc::kMaxTailLineBytes);
  EXPECT_THAT(lines.back().text(), testing::EndsWith("bytes left out)"));
}

TEST(LeaseRunner, SendsItsLogWithAFailureAndNamesTheTraceOfTheJob) {
  const WorkerLog log = Log(spdlog::level::info);
  Rig rig(std::string("this is no scene"), Spec(), 1, log);
  log.log->info("event=before");
  v1::CoordinatorMessage grant = Grant(1);
  grant.mutable_grant()->set_trace_id(kTrace);
  rig.worker->OnMessage(grant);
  const v1::UnitFailure failure = rig.outbox->Await(1).front().failure();
  EXPECT_THAT(Texts(failure.log()),
              ElementsAre("info event=before", testing::AllOf(HasSubstr("error event=unit_failed job=j "),
                                                              HasSubstr(absl::StrCat(" trace=", kTrace)))));
  log.log->info("event=after");
  EXPECT_THAT(Texts(rig.worker->MakeHeartbeat().log()), ElementsAre("info event=after"));
}

TEST(LeaseRunner, TakesNoTraceThatIsNone) {
  const WorkerLog log = Log(spdlog::level::info);
  Rig rig(std::string("this is no scene"), Spec(), 1, log);
  v1::CoordinatorMessage grant = Grant(1);
  grant.mutable_grant()->set_trace_id("abc error=\"forged\"");
  rig.worker->OnMessage(grant);
  EXPECT_THAT(Texts(rig.outbox->Await(1).front().failure().log()),
              ElementsAre(testing::Not(HasSubstr("trace="))));
}

}  // namespace
}  // namespace lumifold::worker
