#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/access_report.h"

namespace lumifold::client {

ExitCode RunIdentities(const std::vector<std::string>& arguments, const Environment& environment) {
  bool all = false;
  v1::ListIdentitiesRequest request;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("identities"));
  command_line.AddFlag("--all", &all, "Also those that have expired, were revoked or used");
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  request.set_valid_only(!all);

  const std::unique_ptr<AccessClient> access = remote.ConnectToAccess(environment);
  bool is_first = true;
  do {
    const absl::StatusOr<v1::ListIdentitiesResponse> page = access->ListIdentities(request);
    if (!page.ok()) return ReportError(environment, page.status());
    if (is_first && !remote.json) environment.out << IdentityTableHead();
    is_first = false;
    for (const v1::Credential& credential : page->credentials())
      environment.out << (remote.json ? IdentityJson(credential) + "\n" : IdentityTableLine(credential));
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  environment.out << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
