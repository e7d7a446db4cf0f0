#include "client/options/hook.h"

#include <memory>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "client/reports/job_report.h"
#include "proto/subprocess/child.h"

namespace lumifold::client {
namespace {

constexpr char kPrefix[] = "LUMIFOLD_";

absl::Status Failed(absl::string_view why) { return absl::InternalError(absl::StrCat("--hook: ", why)); }

}  // namespace

void Hook::AddTo(CommandLine& command_line) {
  command_line.AddText(
      "--hook", "COMMAND", &command,
      "Run this in a shell once the job has ended; $LUMIFOLD_JOB, _NAME, _STATE, _ERROR and _OUTPUT "
      "tell about it");
}

absl::Status Hook::Run(const v1::JobStatus& job, const std::string& output) const {
  if (command.empty()) return absl::OkStatus();
  const auto variable = [](const char* name, absl::string_view value) {
    return absl::StrCat(kPrefix, name, "=", value);
  };
  const absl::StatusOr<std::unique_ptr<subprocess::Child>> child =
      subprocess::Child::Start({.words = {"/bin/sh", "-c", command},
                                .environment =
                                    {
                                        variable("JOB", job.job_id()),
                                        variable("NAME", job.display_name()),
                                        variable("STATE", StateName(job.state())),
                                        variable("ERROR", job.error()),
                                        variable("OUTPUT", output),
                                    },
                                .out = subprocess::Stream::kStandardError});
  if (!child.ok()) return Failed(absl::StrCat("cannot start: ", child.status().message()));
  const absl::StatusOr<subprocess::ExitStatus> exit = (*child)->Wait();
  if (!exit.ok()) return Failed(exit.status().message());
  if (exit->signal != 0 || exit->code != 0) return Failed(exit->Text());
  return absl::OkStatus();
}

}  // namespace lumifold::client
