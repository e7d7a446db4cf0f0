#include <algorithm>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/farm_report.h"

namespace lumifold::client {
namespace {

constexpr int kPageWorkers = 1000;  // the coordinator's limit

bool NameCoordinators(const v1::ListWorkersResponse& page) {
  return std::any_of(page.workers().begin(), page.workers().end(),
                     [](const v1::WorkerStatus& worker) { return !worker.coordinator().empty(); });
}

}  // namespace

ExitCode RunWorkers(const std::vector<std::string>& arguments, const Environment& environment) {
  RemoteOptions remote(environment);
  v1::ListWorkersRequest request;
  CommandLine command_line(WordsOf("workers"));
  command_line.AddOptionalArgument("WORKER", request.mutable_worker(),
                                   "Only this worker, by id (w-...) or name, with its last frames");
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const std::unique_ptr<FarmClient> farm = remote.Connect(environment);
  request.set_limit(kPageWorkers);
  bool is_first = true;
  bool has_any = false;
  bool of_several = false;
  do {
    const absl::StatusOr<v1::ListWorkersResponse> page = farm->ListWorkers(request);
    if (!page.ok()) return ReportError(environment, page.status());
    if (is_first) of_several = NameCoordinators(*page);
    if (is_first && !remote.json) environment.out << WorkerTableHead(of_several);
    is_first = false;
    has_any |= page->workers_size() > 0;
    for (const v1::WorkerStatus& worker : page->workers())
      environment.out << (remote.json ? WorkerJson(worker) + "\n"
                                      : WorkerTableLine(worker, of_several) + HistoryText(worker));
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  environment.out << std::flush;
  if (!has_any && !request.worker().empty())
    return ReportError(environment, absl::NotFoundError(absl::StrCat("no worker '", request.worker(), "'")));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
