#include "proto/subprocess/run_command.h"

#include <cstddef>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/monotonic.h"
#include "proto/subprocess/child.h"

namespace lumifold::subprocess {
namespace {

constexpr size_t kMaxOutputBytes = size_t{64} << 20;

}  // namespace

absl::StatusOr<CommandResult> RunCommand(const std::vector<std::string>& arguments,
                                         const std::vector<std::string>& environment,
                                         absl::Duration timeout) {
  const absl::Time deadline = rpc::MonotonicNow() + timeout;
  const std::string& program = arguments.front();
  const absl::StatusOr<std::unique_ptr<Child>> child = Child::Start({.words = arguments,
                                                                     .environment = environment,
                                                                     .in = Stream::kNothing,
                                                                     .out = Stream::kPipe,
                                                                     .err = Stream::kPipe,
                                                                     .own_group = true});
  if (!child.ok())
    return absl::UnavailableError(absl::StrCat("cannot run ", program, ": ", child.status().message()));
  const std::string too_long = absl::StrCat(program, " took longer than ", absl::FormatDuration(timeout));
  Output output;
  if (!(*child)->ReadOutput(deadline, kMaxOutputBytes, &output))
    return absl::UnavailableError(absl::StrCat(too_long, ", or printed too much"));
  const absl::StatusOr<ExitStatus> exit = (*child)->Wait(deadline);
  if (absl::IsDeadlineExceeded(exit.status())) return absl::UnavailableError(too_long);
  if (!exit.ok()) return absl::UnavailableError(absl::StrCat(program, ": ", exit.status().message()));
  if (exit->signal != 0) return absl::UnavailableError(absl::StrCat(program, " was ", exit->Text()));
  return CommandResult{.exit_code = exit->code, .out = std::move(output.out), .err = std::move(output.err)};
}

}  // namespace lumifold::subprocess
