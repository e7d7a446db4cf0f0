#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/usage_report.h"

namespace lumifold::client {
namespace {

/// The error of an option; empty, and *unix_ms is set, if it is a day or was not given.
std::string ReadDay(const char* option, const std::string& text, int64_t* unix_ms) {
  absl::CivilDay day;
  if (text.empty()) return "";
  if (!absl::ParseCivilTime(text, &day))
    return absl::StrCat(option, ": expected a day such as 2026-11-01; got '", text, "'");
  *unix_ms = absl::ToUnixMillis(absl::FromCivil(day, absl::UTCTimeZone()));
  return "";
}

}  // namespace

ExitCode RunUsage(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string since;
  std::string until;
  v1::GetUsageRequest request;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("usage"));
  command_line.AddText("--since", "DAY", &since,
                       "From this day (UTC) on, such as 2026-11-01 (default: all days)");
  command_line.AddText("--until", "DAY", &until, "To before this day (default: today, included)");
  command_line.AddText("--user", "NAME", request.mutable_user(), "Only jobs of this user");
  remote.AddTo(command_line);
  command_line.SetFooter("Deleted jobs are among them. Days are kept for 400 days.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  int64_t first = 0;
  int64_t last = 0;
  std::string problem = ReadDay("--since", since, &first);
  if (problem.empty()) problem = ReadDay("--until", until, &last);
  if (!problem.empty()) return ReportUsage(environment, "lumifold usage", problem);
  request.set_since_unix_ms(first);
  request.set_until_unix_ms(last);

  const absl::StatusOr<v1::GetUsageResponse> usage = remote.Connect(environment)->GetUsage(request);
  if (!usage.ok()) return ReportError(environment, usage.status());
  environment.out << (remote.json ? UsageJson(*usage) : UsageText(*usage)) << std::flush;
  if (usage->is_cut()) ReportLine(environment, "there are more jobs: name fewer days, or a user");
  return ExitCode::kOk;
}

}  // namespace lumifold::client
