#pragma once

#include <memory>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "client/cli/command_line.h"
#include "client/cli/environment.h"
#include "client/cli/progress.h"
#include "client/farm/access_client.h"
#include "client/farm/backoff.h"
#include "client/farm/farm_client.h"
#include "client/options/hook.h"
#include "proto/identity/profile.h"

namespace lumifold::client {

/// What --threads may be.
constexpr int kMaxThreads = 4096;

/// --device, of commands that filter in this process.
void AddDevice(CommandLine& command_line, std::string* device, bool* allows_other_bits);

/// Options of every command that connects to a coordinator.
struct RemoteOptions {
  explicit RemoteOptions(const Environment& environment)
      : server(environment.defaults.server),
        profile(environment.defaults.profile),
        profiles(environment.profiles_folder),
        configuration_(environment.configuration.file) {}

  /// The options alone: Resolve must be called after command_line.Parse.
  void AddOptions(CommandLine& command_line);
  /// After command_line.Parse, `server` and `security` are those of the profile, if there is one.
  void AddTo(CommandLine& command_line);
  /// Sets `server` and `security` by the profile, whose certificate it renews where that is due. Parse does
  /// it for commands; a program that runs for long repeats it.
  absl::Status Resolve();
  std::unique_ptr<FarmClient> Connect(const Environment& environment) const;
  std::unique_ptr<AccessClient> ConnectToAccess(const Environment& environment) const;
  /// Connect, once `*job` is the id of the job that it means, see FindJob. Errors: those of FindJob.
  absl::StatusOr<std::unique_ptr<FarmClient>> ConnectFor(std::string* job,
                                                         const Environment& environment) const;

  /// Client MakeBackoff, or --timeout.
  Backoff MakeBackoff(const Environment& environment) const;

  /// Those of `server`, once it is resolved.
  const std::vector<std::string>& coordinators() const { return coordinators_; }
  /// A client of one of them, which waits for no storage.
  std::unique_ptr<FarmClient> ConnectTo(const std::string& coordinator, const Environment& environment) const;

  std::string server;   // a list, see rpc::ParseEndpoints
  std::string profile;  // named with --profile
  rpc::Security security;
  bool json = false;
  identity::Profiles profiles;

 private:
  FarmClientOptions ClientOptions(const Environment& environment) const;

  const OptionFile* configuration_;
  float timeout_seconds_ = 0;
  std::vector<std::string> coordinators_;
};

/// Adds --json.
void AddJson(CommandLine& command_line, bool* json);

/// Prints progress to `environment.err`.
std::unique_ptr<Progress> MakeProgressPrinter(const Environment& environment);

/// Retries of commands that follow a job or download a frame: they give up after five minutes without
/// progress.
Backoff MakeBackoff(const Environment& environment);

/// Help of the arguments JOB and WORKER.
inline constexpr char kJobArgumentHelp[] =
    "The job: its id, the beginning or the end of that, its name, or 'last'";
inline constexpr char kWorkerArgumentHelp[] = "The worker's id (w-...) or name, see 'lumifold workers'";

/// The end of a command that changes a job or a worker: prints it as JSON to `out` or, as one line, to `err`;
/// or the error.
ExitCode ReportJob(const Environment& environment, bool json, const absl::StatusOr<v1::JobStatus>& job);
ExitCode ReportWorker(const Environment& environment, bool json,
                      const absl::StatusOr<v1::WorkerStatus>& worker);

/// A command whose only argument is JOB: makes the call and reports the job.
using JobCall = absl::FunctionRef<absl::StatusOr<v1::JobStatus>(FarmClient& farm, const std::string& job_id)>;
ExitCode RunOnJob(const std::string& command, const std::string& footer,
                  const std::vector<std::string>& arguments, const Environment& environment, JobCall call);

/// Prints the outcome of a job to `err`: "lumifold: job X done: ...". Returns the exit code of the outcome.
ExitCode ReportOutcome(const Environment& environment, const v1::JobStatus& job);

/// The end of a command that has followed a job: runs the hook and returns `outcome`, or the hook's error.
ExitCode RunHook(const Hook& hook, const v1::JobStatus& job, const std::string& output, ExitCode outcome,
                 const Environment& environment);

}  // namespace lumifold::client
