#include "client/commands/shared_options.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/colour.h"
#include "client/commands/commands.h"
#include "client/farm/find_job.h"
#include "client/reports/farm_report.h"
#include "client/reports/job_report.h"
#include "proto/identity/certificate.h"
#include "proto/identity/join.h"
#include "proto/identity/secrets.h"
#include "proto/rpc/endpoints.h"

namespace lumifold::client {
namespace {

// Enough time to restart a coordinator or to move it to another machine.
constexpr absl::Duration kMaxOutage = absl::Minutes(5);
/// Whose jobs are that name no user.
constexpr char kNobody[] = "anonymous";

}  // namespace

void AddDevice(CommandLine& command_line, std::string* device, bool* allows_other_bits) {
  command_line.AddText(
      "--device", "DEVICE", device,
      "What filters beside the processor, with the same bits: auto, cpu, gpu, or gpu:N, number N "
      "of 'lumifold doctor' (default auto: a GPU, if there is one)");
  command_line.AddFlag("--allow-other-bits", allows_other_bits,
                       "Allow a GPU that rounds otherwise: the picture differs in the last bits");
}

void RemoteOptions::AddOptions(CommandLine& command_line) {
  command_line.AddAddresses(
      "--server", &server,
      "The coordinator, or those of one farm (default: $LUMIFOLD_SERVER, else those of the profile, else "
      "127.0.0.1:7700)");
  command_line.AddText("--profile", "NAME", &profile,
                       "A profile of 'lumifold login' (default: the coordinator's)");
  command_line.AddFlag("--insecure", &security.insecure,
                       "Allow a coordinator of another machine without encryption");
  command_line.AddPositiveNumber("--timeout", &timeout_seconds_,
                                 "Seconds to wait for a farm that is away (default: 30 where its storage is, "
                                 "300 for jobs and files; no coordinator: at once)");
  AddJson(command_line, &json);
}

void RemoteOptions::AddTo(CommandLine& command_line) {
  AddOptions(command_line);
  command_line.AddCheck([this] { return Resolve(); });
}

std::unique_ptr<FarmClient> RemoteOptions::ConnectTo(const std::string& coordinator,
                                                     const Environment& environment) const {
  FarmClientOptions options = ClientOptions(environment);
  options.coordinators = {coordinator};
  options.patience = absl::ZeroDuration();
  return client::ConnectTo(std::move(options));
}

FarmClientOptions RemoteOptions::ClientOptions(const Environment& environment) const {
  FarmClientOptions options = {.coordinators = coordinators_,
                               .security = security,
                               .time = environment.time,
                               .interrupted = environment.interrupted,
                               .trace_parent = environment.trace_parent};
  if (timeout_seconds_ > 0)
    options.patience = options.patience_without_answer = absl::Seconds(timeout_seconds_);
  return options;
}

std::unique_ptr<FarmClient> RemoteOptions::Connect(const Environment& environment) const {
  return client::ConnectTo(ClientOptions(environment));
}

Backoff RemoteOptions::MakeBackoff(const Environment& environment) const {
  if (timeout_seconds_ == 0) return client::MakeBackoff(environment);
  return {absl::Seconds(timeout_seconds_), environment.time, environment.interrupted};
}

std::unique_ptr<AccessClient> RemoteOptions::ConnectToAccess(const Environment& environment) const {
  return client::ConnectToAccess(ClientOptions(environment));
}

absl::StatusOr<std::unique_ptr<FarmClient>> RemoteOptions::ConnectFor(std::string* job,
                                                                      const Environment& environment) const {
  std::unique_ptr<FarmClient> farm = Connect(environment);
  const auto user = [&]() -> absl::StatusOr<std::string> {
    const std::string& submits = environment.defaults.user;
    if (!security.uses_tls()) return submits.empty() ? kNobody : submits;
    const absl::StatusOr<v1::WhoAmIResponse> caller = ConnectToAccess(environment)->WhoAmI();
    if (!caller.ok()) return caller.status();
    return caller->name();
  };
  absl::StatusOr<std::string> id = FindJob(*farm, *job, user);
  if (!id.ok()) return id.status();
  *job = *std::move(id);
  return farm;
}

absl::Status RemoteOptions::Resolve() {
  // A profile of the configuration needs no identity.
  const std::vector<std::string> identities = profiles.List();
  const bool has_identity = std::find(identities.begin(), identities.end(), profile) != identities.end();
  if (!has_identity && configuration_ != nullptr && configuration_->profiles.contains(profile))
    profile.clear();
  const absl::StatusOr<std::optional<std::string>> chosen =
      profiles.Choose(profile, server, identity::Profile::Kind::kPerson);
  if (!chosen.ok()) return OfThisMachine(chosen.status());
  if (chosen->has_value()) {
    identity::ProtectMemory();
    // One that fails may succeed with the next command: until its end the certificate is good.
    absl::Status renewed = identity::RenewIfDue(profiles, **chosen, identity::ValidityClock());
    if (absl::IsUnauthenticated(renewed)) return renewed;
    const absl::StatusOr<identity::Profile> read = profiles.Read(**chosen);
    absl::StatusOr<rpc::Security> found = profiles.SecurityOf(**chosen);
    if (!read.ok()) return OfThisMachine(read.status());
    if (!found.ok()) return OfThisMachine(found.status());
    profile = **chosen;
    if (server.empty()) server = read->server;
    security = *std::move(found);
  }
  if (server.empty()) server = kDefaultServer;
  absl::StatusOr<std::vector<std::string>> addresses = rpc::ParseEndpoints(server);
  if (!addresses.ok()) return addresses.status();
  coordinators_ = *std::move(addresses);
  for (const std::string& address : coordinators_) {
    if (absl::Status status = rpc::CheckServerAddress(address, security); !status.ok()) return status;
  }
  return absl::OkStatus();
}

void AddJson(CommandLine& command_line, bool* json) {
  command_line.AddFlag("--json", json, "Print JSON for programs, one object a line");
}

std::unique_ptr<Progress> MakeProgressPrinter(const Environment& environment) {
  return std::make_unique<ProgressPrinter>(
      environment.err, ProgressPrinterOptions{.terminal = environment.terminal.err_is_terminal,
                                              .columns = environment.terminal.columns,
                                              .now = environment.time.now});
}

Backoff MakeBackoff(const Environment& environment) {
  return {kMaxOutage, environment.time, environment.interrupted};
}

ExitCode ReportJob(const Environment& environment, bool json, const absl::StatusOr<v1::JobStatus>& job) {
  if (!job.ok()) return ReportError(environment, job.status());
  if (json) environment.out << JobJson(*job) << "\n" << std::flush;
  ReportOutcome(environment, *job);
  return ExitCode::kOk;
}

ExitCode ReportWorker(const Environment& environment, bool json,
                      const absl::StatusOr<v1::WorkerStatus>& worker) {
  if (!worker.ok()) return ReportError(environment, worker.status());
  if (json) environment.out << WorkerJson(*worker) << "\n" << std::flush;
  ReportLine(environment, absl::StrCat("worker ", worker->name(), " ", WorkerStateName(worker->state())));
  return ExitCode::kOk;
}

ExitCode RunOnJob(const std::string& command, const std::string& footer,
                  const std::vector<std::string>& arguments, const Environment& environment, JobCall call) {
  std::string job_id;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf(command));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  remote.AddTo(command_line);
  command_line.SetFooter(footer);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  const absl::StatusOr<std::unique_ptr<FarmClient>> farm = remote.ConnectFor(&job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  return ReportJob(environment, remote.json, call(**farm, job_id));
}

ExitCode RunHook(const Hook& hook, const v1::JobStatus& job, const std::string& output, ExitCode outcome,
                 const Environment& environment) {
  const absl::Status status = hook.Run(job, output);
  return status.ok() ? outcome : ReportError(environment, status);
}

ExitCode ReportOutcome(const Environment& environment, const v1::JobStatus& job) {
  const Colour colour = job.state() == v1::JOB_STATE_DONE     ? Colour::kGreen
                        : job.state() == v1::JOB_STATE_FAILED ? Colour::kRed
                                                              : Colour::kYellow;
  const std::string state = Coloured(environment.terminal.err_has_colours, colour, StateName(job.state()));
  std::string line = absl::StrCat("job ", job.job_id(), " ", state);
  if (!job.error().empty()) absl::StrAppend(&line, ": ", job.error());
  if (const auto skipped = SkippedFrames(job); !skipped.empty())
    absl::StrAppend(&line, ": skipped: ", TextOf(skipped));
  if (IsDone(job)) absl::StrAppend(&line, ": ", StageTimesText(job.times()));
  ReportLine(environment, line);
  return ExitCodeForOutcome(job);
}

}  // namespace lumifold::client
