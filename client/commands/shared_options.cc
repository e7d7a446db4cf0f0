#include "client/commands/shared_options.h"

#include "absl/strings/str_cat.h"
#include "client/job_report.h"

namespace lumifold::client {
namespace {

// Enough time to restart a coordinator or to move it to another machine.
constexpr absl::Duration kMaxOutage = absl::Minutes(5);

}  // namespace

void RemoteOptions::AddTo(CommandLine& command_line) {
  command_line.AddAddress("--server", &server,
                          "The coordinator (default: $LUMIFOLD_SERVER, else 127.0.0.1:7700)");
  AddJson(command_line, &json);
}

std::unique_ptr<FarmClient> RemoteOptions::Connect(const Environment& environment) const {
  return ConnectTo({.coordinator = server, .time = environment.time, .interrupted = environment.interrupted});
}

void AddJson(CommandLine& command_line, bool* json) {
  command_line.AddFlag("--json", json, "Print JSON for programs, one object a line");
}

std::unique_ptr<Progress> MakeProgressPrinter(const Environment& environment) {
  return std::make_unique<ProgressPrinter>(environment.err,
                                           ProgressPrinterOptions{.terminal = environment.err_is_terminal,
                                                                  .columns = environment.terminal_columns,
                                                                  .now = environment.time.now});
}

Backoff MakeBackoff(const Environment& environment) {
  return {kMaxOutage, environment.time, environment.interrupted};
}

ExitCode ReportOutcome(const Environment& environment, const v1::JobStatus& job) {
  std::string line = absl::StrCat("job ", job.job_id(), " ", StateName(job.state()));
  if (!job.error().empty()) absl::StrAppend(&line, ": ", job.error());
  if (job.state() == v1::JOB_STATE_DONE) absl::StrAppend(&line, ": ", StageTimesText(job.times()));
  ReportLine(environment, line);
  return ExitCodeForOutcome(job);
}

}  // namespace lumifold::client
