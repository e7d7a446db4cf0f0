#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {
namespace {

std::string UrlOf(const v1::PageLink& link, const std::string& job_id) {
  return absl::StrCat(link.scheme(), "://", link.host(), ":", link.port(), "/#session=", link.session(),
                      job_id.empty() ? "" : absl::StrCat("&job=", job_id));
}

}  // namespace

ExitCode RunPage(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  bool share = false;
  v1::CreatePageLinkRequest request;
  int hours = 0;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("page"));
  command_line.AddOptionalArgument("JOB", &job_id, "The page begins with this job");
  command_line.AddFlag("--share", &share, "A link for others: it shows JOB only, and changes nothing");
  command_line.AddWholeNumber("--hours", &hours, 1, 720, "Time until the link ends (default 12)");
  remote.AddTo(command_line);
  command_line.SetFooter(
      "Whoever has the link acts in your name until it ends. Give away links of --share only.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (share && job_id.empty())
    return ReportUsage(environment, "lumifold page", "--share: expected a JOB to show");

  const absl::StatusOr<std::unique_ptr<FarmClient>> farm =
      job_id.empty() ? remote.Connect(environment) : remote.ConnectFor(&job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  if (share) request.set_job_id(job_id);
  request.set_hours(hours);
  const absl::StatusOr<v1::PageLink> link = (*farm)->CreatePageLink(request);
  if (!link.ok()) return ReportError(environment, link.status());
  const std::string url = UrlOf(*link, job_id);
  const nlohmann::ordered_json json = {{"url", url}, {"expires_unix_ms", link->expires_unix_ms()}};
  environment.out << (remote.json ? JsonLine(json) : url) << "\n" << std::flush;
  if (link->loopback()) environment.err << "The page is reached on the coordinator's machine only.\n";
  return ExitCode::kOk;
}

}  // namespace lumifold::client
