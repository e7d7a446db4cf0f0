// Every report of every message whose fields are all set, each to another value, and of an empty one, beside
// what it was when people looked at it (reports.txt): a field that is missing or in a wrong place shows.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/reports/access_report.h"
#include "client/reports/farm_report.h"
#include "client/reports/job_report.h"
#include "client/reports/plan_report.h"
#include "client/reports/usage_report.h"
#include "tests/support/filled_message.h"

namespace lumifold::client {
namespace {

/// JSON as lines of at most one field.
std::string Lines(const std::string& json) {
  return absl::StrReplaceAll(json, {{",\"", ",\n\""}, {"},{", "},\n{"}}) + "\n";
}

template <typename Message, typename... Reports>
std::string OfEach(Reports... reports) {
  std::string text;
  // The values of an enum change with the number.
  for (const Message& message : {FilledMessage<Message>(1), FilledMessage<Message>(1000), Message()}) {
    absl::StrAppend(&text, "== ", std::string(Message::descriptor()->name()), "\n");
    (absl::StrAppend(&text, reports(message)), ...);
  }
  return text;
}

/// A report that makes JSON.
template <typename Report>
auto InLines(Report report) {
  return [report](const auto& message) { return Lines(report(message)); };
}

TEST(Reports, HaveEachFieldInItsPlace) {
  const std::string all = absl::StrCat(
      OfEach<v1::JobStatus>(InLines([](const auto& job) { return JobJson(job, {{"output", "a.exr"}}); }),
                            JobText, JobTableLine),
      OfEach<v1::WorkerStatus>(
          InLines(WorkerJson), HistoryText, [](const auto& worker) { return WorkerTableLine(worker, true); },
          [](const auto& worker) { return WorkerTableLine(worker, false); }),
      OfEach<v1::ExplainJobResponse>(InLines(ExplanationJson), ExplanationText),
      OfEach<v1::LogEvent>(InLines(LogEventJson), LogEventLine),
      OfEach<v1::ServerStatus>(InLines(ServerStatusJson), ServerStatusText),
      OfEach<v1::WhoAmIResponse>(InLines(WhoAmIJson), WhoAmIText),
      OfEach<v1::CreateInviteResponse>(InLines(InviteJson)),
      OfEach<v1::Credential>(InLines(IdentityJson), IdentityTableLine),
      OfEach<v1::Plan>(InLines(PlanJson), PlanTable),
      OfEach<v1::GetUsageResponse>(InLines(UsageJson), UsageText));
  std::stringstream known;
  known << std::ifstream(std::filesystem::path(__FILE__).parent_path() / "reports.txt").rdbuf();
  const std::vector<std::string> expected = absl::StrSplit(known.str(), '\n');
  const std::vector<std::string> actual = absl::StrSplit(all, '\n');
  for (size_t i = 0; i < std::max(expected.size(), actual.size()); ++i)
    ASSERT_EQ(i < actual.size() ? actual[i] : "(no line)", i < expected.size() ? expected[i] : "(no line)")
        << "line " << i + 1 << " of reports.txt; all of them are:\n"
        << all;
}

}  // namespace
}  // namespace lumifold::client
