#pragma once

#include <memory>
#include <string>

#include "client/backoff.h"
#include "client/command_line.h"
#include "client/environment.h"
#include "client/farm_client.h"
#include "client/progress.h"

namespace lumifold::client {

/// The options of every command that speaks to a coordinator elsewhere.
struct RemoteOptions {
  explicit RemoteOptions(const Environment& environment) : server(environment.default_server) {}

  void AddTo(CommandLine& command_line);
  std::unique_ptr<FarmClient> Connect(const Environment& environment) const;

  std::string server;
  bool json = false;
};

/// --json, with what the command prints then.
void AddJson(CommandLine& command_line, bool* json);

/// The printer of progress for people, on `environment.err`.
std::unique_ptr<Progress> MakeProgressPrinter(const Environment& environment);

/// How long a coordinator may be out of reach before whoever follows a job gives up.
Backoff MakeBackoff(const Environment& environment);

/// Says on `err` how a job ended: "lumifold: job X is done: ...". Gives its fate's exit code.
ExitCode ReportFate(const Environment& environment, const v1::JobStatus& job);

}  // namespace lumifold::client
