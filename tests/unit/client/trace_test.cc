#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/commands/run_client.h"
#include "client/reports/farm_report.h"
#include "client/reports/job_report.h"
#include "tests/unit/client/fake_farm.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr char kTrace[] = "4bf92f3577b34da6a3ce929d0e0e4736";
constexpr char kParent[] = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

TEST(Trace, IsSentWithCallsAndPrinted) {
  FakeFarm farm;
  const ScratchFolder folder;
  const std::string scene = folder.Write("room.gltf", R"({"asset":{"version":"2.0"}})");
  TestEnvironment test;
  test.environment.defaults.server = farm.address();
  const auto submit = [&](const std::string& trace_parent) {
    test.environment.trace_parent = trace_parent;
    const std::vector<const char*> argv = {"lumifold", "submit", scene.c_str(), "--json"};
    EXPECT_EQ(RunClient(static_cast<int>(argv.size()), argv.data(), test.environment), 0) << test.err.str();
    return farm.submissions().back().scheduling().trace_id();
  };
  EXPECT_EQ(submit(kParent), kTrace);
  EXPECT_EQ(test.out.str(),
            absl::StrCat(R"({"schema_version":1,"job_id":"job-1","trace_id":")", kTrace, "\"}\n"));
  EXPECT_EQ(submit(""), "");
}

TEST(Trace, IsPartOfTheStatusOfAJob) {
  v1::JobStatus job;
  EXPECT_THAT(JobText(job), Not(HasSubstr("trace")));
  job.mutable_scheduling()->set_trace_id(kTrace);
  EXPECT_THAT(JobText(job), HasSubstr(absl::StrCat("trace: ", kTrace, "\n")));
  EXPECT_THAT(JobJson(job), HasSubstr(absl::StrCat(R"("trace_id":")", kTrace, "\"")));
  v1::ExplainJobResponse explanation;
  *explanation.mutable_status() = job;
  EXPECT_THAT(ExplanationJson(explanation), HasSubstr(absl::StrCat(R"("trace_id":")", kTrace, "\"")));
}

TEST(LogEvent, NamesTheWorkerThatWroteIt) {
  v1::LogEvent event;
  event.set_unix_ms(1'000);
  event.set_level("error");
  event.set_worker("w-7/node:1");
  event.set_text("event=unit_failed error=\"\xff\"");
  EXPECT_EQ(LogEventLine(event),
            "1970-01-01T00:00:01.000Z error w-7/node:1: event=unit_failed error=\"\xff\"\n");
  EXPECT_EQ(
      LogEventJson(event),
      R"({"schema_version":1,"unix_ms":1000,"level":"error","worker":"w-7/node:1","text":"event=unit_failed error=\"�\""})");
}

}  // namespace
}  // namespace lumifold::client
