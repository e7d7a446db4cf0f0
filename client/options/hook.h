#pragma once

#include <string>

#include "absl/status/status.h"
#include "client/cli/command_line.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// A command of the user's shell that runs once a job has ended.
struct Hook {
  /// Adds --hook.
  void AddTo(CommandLine& command_line);

  /// Runs the command, if there is one, and waits for it. It learns of the job by the environment variables
  /// LUMIFOLD_JOB, LUMIFOLD_NAME, LUMIFOLD_STATE, LUMIFOLD_ERROR and LUMIFOLD_OUTPUT (`output`: the path of
  /// the picture). None of these is part of the command's text, so that no name can become a command. What it
  /// prints goes to standard error.
  /// Errors: kInternal where it cannot be started or does not end with 0.
  absl::Status Run(const v1::JobStatus& job, const std::string& output) const;

  std::string command;
};

}  // namespace lumifold::client
