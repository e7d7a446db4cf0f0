#pragma once

#include <memory>
#include <string>

#include "client/backoff.h"
#include "client/command_line.h"
#include "client/environment.h"
#include "client/farm_client.h"
#include "client/progress.h"

namespace lumifold::client {

/// Options of every command that connects to a coordinator.
struct RemoteOptions {
  explicit RemoteOptions(const Environment& environment) : server(environment.default_server) {}

  void AddTo(CommandLine& command_line);
  std::unique_ptr<FarmClient> Connect(const Environment& environment) const;

  std::string server;
  bool json = false;
};

/// Adds --json.
void AddJson(CommandLine& command_line, bool* json);

/// Prints progress to `environment.err`.
std::unique_ptr<Progress> MakeProgressPrinter(const Environment& environment);

/// Retries of commands that follow a job or download a frame: they give up after five minutes without
/// progress.
Backoff MakeBackoff(const Environment& environment);

/// Prints the outcome of a job to `err`: "lumifold: job X done: ...". Returns the exit code of the outcome.
ExitCode ReportOutcome(const Environment& environment, const v1::JobStatus& job);

}  // namespace lumifold::client
