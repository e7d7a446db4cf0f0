#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "client/autoscale/autoscaler.h"
#include "client/autoscale/read_farm.h"
#include "client/autoscale/slurm_engine.h"
#include "client/autoscale/state_file.h"
#include "client/cli/interrupt.h"
#include "client/commands/shared_options.h"
#include "proto/identity/certificate.h"
#include "proto/identity/profile.h"
#include "proto/logging/fields.h"
#include "proto/logging/front_logger.h"
#include "proto/logging/log_flags.h"
#include "proto/logging/nonblocking_log.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/version.h"
#include "proto/service/help_style.h"
#include "proto/service/service_manager.h"
#include "proto/threads/end_process.h"
#include "spdlog/spdlog.h"

namespace {

namespace autoscale = lumifold::autoscale;
namespace client = lumifold::client;

constexpr absl::Duration kTick = absl::Milliseconds(100);
constexpr size_t kMaxFarmNameBytes = 64;

struct FarmFlags {
  std::string server;
  std::string profile;
  bool insecure = false;
  std::vector<std::string> tags;
};

struct TuningFlags {
  autoscale::Tuning counts;  // what is no number of seconds
  double finish_seconds = absl::ToDoubleSeconds(counts.finish_within);
  double idle_seconds = absl::ToDoubleSeconds(counts.idle);
  double first_pause_seconds = absl::ToDoubleSeconds(counts.pauses.first);
  double longest_pause_seconds = absl::ToDoubleSeconds(counts.pauses.longest);
  double start_seconds = absl::ToDoubleSeconds(counts.start_time);
  double join_seconds = absl::ToDoubleSeconds(counts.join_within);
};

struct SlurmFlags {
  std::string farm = "farm";
  std::string script;
  std::vector<std::string> sbatch_arguments;
  std::vector<std::string> worker_arguments;
  double call_seconds = 30;
};

struct Flags {
  FarmFlags farm;
  std::string state;
  bool once = false;
  bool dry_run = false;
  bool json = false;
  lumifold::logging::LogOptions log = {.name = "autoscale"};
  double interval_seconds = 15;
  autoscale::Limits limits;
  double budget_days = 0;
  TuningFlags tuning;
  SlurmFlags slurm;
};

void AddFarmFlags(CLI::App* app, FarmFlags* flags) {
  app->add_option(
         "--server", flags->server,
         "The coordinator (default: $LUMIFOLD_SERVER, else that of the profile, else 127.0.0.1:7700)")
      ->type_name("HOST:PORT");
  app->add_option("--profile", flags->profile, "A profile of 'lumifold login'; scope read is enough")
      ->type_name("NAME");
  app->add_flag("--insecure", flags->insecure, "Allow a coordinator of another machine without encryption");
  app->add_option("--tags", flags->tags,
                  "Tags of the workers that are started; jobs that need others are not counted")
      ->type_name("TAG,...")
      ->delimiter(',');
}

void AddLimitFlags(CLI::App* app, Flags* flags) {
  autoscale::Limits& limits = flags->limits;
  const CLI::Range workers(0, 100'000);
  app->add_option("--min", limits.minimum, "Workers that are always there")
      ->check(workers)
      ->capture_default_str();
  app->add_option("--max", limits.maximum, "Workers at most")->check(workers)->capture_default_str();
  app->add_option("--max-per-user", limits.per_user, "Workers for the jobs of one user; 0: no limit")
      ->check(workers)
      ->capture_default_str();
  app->add_option("--budget-core-hours", limits.budget_core_hours, "Core-hours of all workers; 0: no limit")
      ->check(CLI::Range(0.0, 1e12))
      ->capture_default_str();
  app->add_option("--budget-days", flags->budget_days, "Days after which the budget begins again; 0: never")
      ->check(CLI::Range(0.0, 36500.0))
      ->capture_default_str();
}

void AddTuningFlags(CLI::App* app, Flags* flags) {
  const auto seconds = [app](const char* name, double* value, const char* help) {
    app->add_option(name, *value, help)->check(CLI::Range(0.1, 1e9))->capture_default_str();
  };
  seconds("--interval-seconds", &flags->interval_seconds, "Time between two looks");
  seconds("--finish-seconds", &flags->tuning.finish_seconds,
          "Ask for as many workers as finish all units in this time");
  seconds("--idle-seconds", &flags->tuning.idle_seconds, "Release a worker that was idle for this time");
  seconds("--first-pause-seconds", &flags->tuning.first_pause_seconds,
          "Pause after a refusal, or after workers that died at their start; doubled with each");
  seconds("--longest-pause-seconds", &flags->tuning.longest_pause_seconds, "The longest of these pauses");
  seconds("--start-seconds", &flags->tuning.start_seconds,
          "A worker that ends within this time has died at its start");
  seconds("--join-seconds", &flags->tuning.join_seconds,
          "Release a worker that has not joined the farm after this time");
  seconds("--call-seconds", &flags->slurm.call_seconds, "Limit of each command of Slurm");
  app->add_option("--slots", flags->tuning.counts.slots_per_worker,
                  "Units a worker takes at a time, until one has joined")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app->add_option("--cores", flags->tuning.counts.cores_per_worker, "Processors of a worker, for the budget")
      ->check(CLI::Range(0.01, 1e5))
      ->capture_default_str();
}

void AddSlurmFlags(CLI::App* app, SlurmFlags* flags) {
  app->add_option("--farm", flags->farm, "Name of the farm, part of the names of its jobs")
      ->type_name("NAME")
      ->capture_default_str();
  app->add_option("--script", flags->script, "The batch script, deploy/slurm/worker.sbatch")
      ->type_name("FILE")
      ->required()
      ->check(CLI::ExistingFile);
  app->add_option("--sbatch", flags->sbatch_arguments, "An argument of sbatch; may be repeated")
      ->type_name("ARGUMENT")
      ->allow_extra_args(false);
  app->add_option("--worker", flags->worker_arguments, "An argument of lumifold-worker; may be repeated")
      ->type_name("ARGUMENT")
      ->allow_extra_args(false);
}

void AddFlags(CLI::App* app, Flags* flags) {
  AddSlurmFlags(app, &flags->slurm);
  AddFarmFlags(app, &flags->farm);
  AddLimitFlags(app, flags);
  AddTuningFlags(app, flags);
  app->add_option("--state", flags->state, "File that keeps core-hours and failures over restarts")
      ->type_name("FILE")
      ->required();
  app->add_flag("--once", flags->once, "Look, decide and act once, and print the decision");
  app->add_flag("--dry-run", flags->dry_run, "Start and release nothing: print what would be done");
  app->add_flag("--json", flags->json, "Print each decision as JSON, one object a line");
  lumifold::logging::AddLogFlags(app, &flags->log);
  app->footer(
      "Example: lumifold-autoscale --script worker.sbatch --state scale.state --max 20\n"
      "Exit codes: 0 ok (SIGINT and SIGTERM end it; workers stay), 1 failed, 2 wrong command line,\n"
      "3 coordinator not reachable (with --once; else it goes on trying).");
  app->set_version_flag("--version",
                        absl::StrCat("lumifold-autoscale ", std::string(lumifold::rpc::kVersion)),
                        "Print the version and exit");
}

bool IsName(const std::string& text) {
  return !text.empty() && text.size() <= kMaxFarmNameBytes &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) {
           return absl::ascii_isalnum(c) || c == '-' || c == '_' || c == '.';
         });
}

/// The error of what the parser does not check; empty if there is none.
std::string Problem(const Flags& flags) {
  if (flags.limits.minimum > flags.limits.maximum) return "--min is larger than --max";
  return IsName(flags.slurm.farm) ? "" : "--farm: 1 to 64 letters, digits, '-', '_' and '.'";
}

std::unique_ptr<autoscale::Engine> MakeEngine(const Flags& flags) {
  autoscale::SlurmOptions options{.farm = flags.slurm.farm,
                                  .script = flags.slurm.script,
                                  .sbatch_arguments = flags.slurm.sbatch_arguments,
                                  .script_arguments = flags.slurm.worker_arguments,
                                  .timeout = absl::Seconds(flags.slurm.call_seconds)};
  if (!flags.farm.tags.empty()) {
    options.script_arguments.push_back("--tags");
    options.script_arguments.push_back(absl::StrJoin(flags.farm.tags, ","));
  }
  return autoscale::MakeSlurmEngine(std::move(options));
}

autoscale::AutoscalerOptions OptionsOf(const Flags& flags) {
  autoscale::AutoscalerOptions options{
      .limits = flags.limits, .tuning = flags.tuning.counts, .dry_run = flags.dry_run};
  if (flags.budget_days > 0) options.limits.budget_period = absl::Hours(24 * flags.budget_days);
  options.tuning.finish_within = absl::Seconds(flags.tuning.finish_seconds);
  options.tuning.idle = absl::Seconds(flags.tuning.idle_seconds);
  options.tuning.pauses.first = absl::Seconds(flags.tuning.first_pause_seconds);
  options.tuning.pauses.longest = absl::Seconds(flags.tuning.longest_pause_seconds);
  options.tuning.start_time = absl::Seconds(flags.tuning.start_seconds);
  options.tuning.join_within = absl::Seconds(flags.tuning.join_seconds);
  options.now = lumifold::identity::ValidityClock;
  return options;
}

int Fail(const absl::Status& status) {
  std::fprintf(stderr, "lumifold-autoscale: %s\n", std::string(status.message()).c_str());
  return static_cast<int>(client::ExitCodeFor(status));
}

void Pause(double seconds, lumifold::service::ServiceManager* manager) {
  const absl::Time end = lumifold::rpc::MonotonicNow() + absl::Seconds(seconds);
  while (!client::Interrupted() && lumifold::rpc::MonotonicNow() < end) {
    manager->Alive();
    absl::SleepFor(kTick);
  }
}

/// Steps until the program is told to end.
int RunSteps(const Flags& flags, autoscale::Autoscaler* autoscaler, spdlog::logger* log) {
  lumifold::service::ServiceManager manager;
  if (!flags.once) manager.Ready("watches the queue");
  do {
    const absl::StatusOr<autoscale::Decision> decision = autoscaler->Step();
    if (!decision.ok() && flags.once) return Fail(decision.status());
    if (!decision.ok()) {
      log->warn("event=step_failed error={}", lumifold::logging::Quoted(decision.status().message()));
    } else if (flags.json) {
      std::cout << DecisionJson(*decision) << '\n' << std::flush;
    } else if (flags.once || flags.dry_run) {
      std::cout << DecisionText(*decision) << std::flush;
    }
    if (flags.once) return 0;
    Pause(flags.interval_seconds, &manager);
  } while (!client::Interrupted());
  manager.Stopping();
  log->info("event=stop");
  return 0;
}

int Run(const Flags& flags) {
  if (flags.log.format == "json") setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);  // its lines are no JSON
  client::CatchInterrupts();
  client::Environment environment{.out = std::cout, .err = std::cerr};
  environment.profiles_folder = lumifold::identity::ProfilesFolder();
  if (const char* server = std::getenv("LUMIFOLD_SERVER")) environment.defaults.server = server;
  environment.interrupted = client::Interrupted;
  client::RemoteOptions remote(environment);
  if (!flags.farm.server.empty()) remote.server = flags.farm.server;
  remote.profile = flags.farm.profile;
  remote.security.insecure = flags.farm.insecure;
  if (absl::Status status = remote.Resolve(); !status.ok()) return Fail(status);
  absl::StatusOr<autoscale::StateFile> state = autoscale::StateFile::Open(flags.state);
  if (!state.ok()) return Fail(client::OfThisMachine(state.status()));
  absl::StatusOr<autoscale::History> history = state->Read();
  if (!history.ok()) return Fail(client::OfThisMachine(history.status()));
  const std::shared_ptr<spdlog::logger> log =
      lumifold::logging::MakeFrontLogger({.log = lumifold::logging::MakeNonblockingLogger(flags.log)});
  log->info("event=start server={} min={} max={}", remote.server, flags.limits.minimum, flags.limits.maximum);
  autoscale::AutoscalerOptions options = OptionsOf(flags);
  options.read_farm = [&]() -> absl::StatusOr<autoscale::FarmState> {
    if (absl::Status status = remote.Resolve(); !status.ok()) return status;
    return autoscale::ReadFarm(*remote.Connect(environment), flags.farm.tags);
  };
  options.keep = [&](const autoscale::History& now) { return state->Write(now); };
  options.log = log;
  const std::unique_ptr<autoscale::Engine> engine = MakeEngine(flags);
  autoscale::Autoscaler autoscaler(std::move(options), *std::move(history), engine.get());
  return RunSteps(flags, &autoscaler, log.get());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app(
      "Asks Slurm for as many workers as a coordinator's queue needs, within limits, and lets idle ones go.",
      "lumifold-autoscale");
  lumifold::service::SetHelpStyle(&app);
  Flags flags;
  AddFlags(&app, &flags);
  std::string problem;
  try {
    app.parse(argc, argv);
    problem = Problem(flags);
  } catch (const CLI::Success& success) {
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    problem = error.what();
  }
  if (problem.empty()) lumifold::threads::EndProcess(Run(flags));
  std::fprintf(stderr, "lumifold-autoscale: %s\n", problem.c_str());
  return static_cast<int>(client::ExitCode::kUsage);
}
