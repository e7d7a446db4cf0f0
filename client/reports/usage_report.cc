#include "client/reports/usage_report.h"

#include <map>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/json_line.h"

namespace lumifold::client {
namespace {

constexpr double kHour = 3600;

std::string Line(const std::string& name, const v1::JobUsage& usage) {
  return absl::StrFormat("%-20s %-16s %14.3f %14.3f %9d %8d\n", name, usage.user(),
                         usage.render_seconds() / kHour, usage.finish_seconds() / kHour, usage.units(),
                         usage.frames());
}

std::string Head(const char* name) {
  return absl::StrFormat("%-20s %-16s %14s %14s %9s %8s\n", name, "USER", "RENDER CORE-H", "FINISH CORE-H",
                         "UNITS", "FRAMES");
}

}  // namespace

std::string UsageText(const v1::GetUsageResponse& usage) {
  std::map<std::string, v1::JobUsage> users;
  std::map<std::string, int> jobs;
  for (const v1::JobUsage& job : usage.jobs()) {
    v1::JobUsage& user = users[job.user()];
    user.set_user(job.user());
    user.set_units(user.units() + job.units());
    user.set_render_seconds(user.render_seconds() + job.render_seconds());
    user.set_frames(user.frames() + job.frames());
    user.set_finish_seconds(user.finish_seconds() + job.finish_seconds());
    ++jobs[job.user()];
  }
  std::string text = Head("JOBS");
  for (const auto& [name, user] : users) text += Line(absl::StrCat(jobs[name]), user);
  absl::StrAppend(&text, "\n", Head("JOB"));
  for (const v1::JobUsage& job : usage.jobs()) text += Line(job.job_id(), job);
  return text;
}

std::string UsageJson(const v1::GetUsageResponse& usage) {
  std::string lines;
  for (const v1::JobUsage& job : usage.jobs()) {
    const nlohmann::ordered_json json{{"job_id", job.job_id()},
                                      {"user", job.user()},
                                      {"render_core_seconds", job.render_seconds()},
                                      {"finish_core_seconds", job.finish_seconds()},
                                      {"units", job.units()},
                                      {"frames", job.frames()}};
    absl::StrAppend(&lines, JsonLine(json), "\n");
  }
  return lines;
}

}  // namespace lumifold::client
