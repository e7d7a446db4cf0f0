#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace lumifold::subprocess {

struct CommandResult {
  int exit_code = 0;
  std::string out;
  std::string err;
};

/// Runs a program to its end, without a shell and without standard input. `environment`: as that of
/// ChildOptions. A program that takes longer is killed with its children.
/// Errors: kUnavailable when it cannot be started, takes longer than `timeout`, prints more than 64 MiB, or
/// is killed by a signal. All name the program.
absl::StatusOr<CommandResult> RunCommand(const std::vector<std::string>& arguments,
                                         const std::vector<std::string>& environment, absl::Duration timeout);

}  // namespace lumifold::subprocess
