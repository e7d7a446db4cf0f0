#pragma once

#include "absl/status/status.h"

namespace lumifold::client {

/// Exit codes of the program. Scripts rely on these numbers: they never change.
enum class ExitCode : int {
  kOk = 0,
  kFailed = 1,       // the job failed, or any other error
  kUsage = 2,        // the command line, or a setting in it, is wrong
  kUnreachable = 3,  // the coordinator does not answer
  kNotFound = 4,     // no such job, frame, worker or file
  kCancelled = 5,    // the job was cancelled
  kGaps = 6,         // frames of the job are skipped
  kInterrupted = 130,
};

/// The same as text, for the end of every help page.
inline constexpr char kExitCodesHelp[] =
    "Exit codes: 0 ok, 1 failed, 2 wrong command line, 3 coordinator not reachable, 4 no such job, frame, "
    "worker\n"
    "or file, 5 job cancelled, 6 done with gaps, 130 interrupted.";

/// The exit code of an error. kCancelled means that the user interrupted the program; a cancelled job is a
/// state, not an error.
ExitCode ExitCodeFor(const absl::Status& status);

/// The same error as kInternal, unless it is kOk. For errors of local files: file code returns kUnavailable
/// for disk errors, but in the client kUnavailable means that the coordinator cannot be reached.
absl::Status OfThisMachine(const absl::Status& status);

}  // namespace lumifold::client
