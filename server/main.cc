#include <google/protobuf/stubs/logging.h>
#include <signal.h>
#include <spdlog/sinks/null_sink.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "filter/opencl/open_device.h"
#include "proto/device/device_option.h"
#include "proto/device/device_process.h"
#include "proto/device/serve_device.h"
#include "proto/identity/certificate.h"
#include "proto/identity/secrets.h"
#include "proto/logging/fields.h"
#include "proto/logging/log_flags.h"
#include "proto/logging/nonblocking_log.h"
#include "proto/monitoring/metrics_flag.h"
#include "proto/rpc/version.h"
#include "proto/service/help_style.h"
#include "proto/service/service_manager.h"
#include "proto/threads/end_process.h"
#include "server/access/access_control.h"
#include "server/access/setup.h"
#include "server/commit/recover.h"
#include "server/finish/frame_finisher.h"
#include "server/ledger/open_job_store.h"
#include "server/limits.h"
#include "server/net/health_check.h"
#include "server/preview/make_preview.h"
#include "server/server.h"
#include "server/storage/data_folder.h"

namespace {

using lumifold::service::ServiceManager;

constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;
constexpr double kBytesPerGb = 1e9;
/// The process sends it to itself when its jobs belong to another coordinator.
constexpr int kExpelled = SIGUSR1;
/// Before a start that failed because of the ledger is tried again, after an expulsion.
constexpr timespec kStartPause = {.tv_sec = 1, .tv_nsec = 0};

/// Of several coordinators over one store.
struct FarmFlags {
  std::string advertise;
  double failover_seconds = 3.0;
};

struct PageFlags {
  std::string address = "127.0.0.1:0";
  std::string certificate;
};

struct FilterFlags {
  int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  int processes = 0;
  uint64_t memory_mb = 0;
  double minutes = 1440.0;
  lumifold::filter::DeviceChoice device;
};

/// What may lie on the disk.
struct DiskFlags {
  uint64_t reserve_mb = 16;
  double keep_film_gb = 10;
  double keep_results_days = 0;
  double quota_gb = 0;
};

/// What callers may take.
struct LimitFlags {
  lumifold::server::Limits counts;  // what is no number of GB
  double max_asset_gb = static_cast<double>(counts.assets.asset_bytes) / kBytesPerGb;
  double max_job_gb = static_cast<double>(counts.jobs.job_asset_bytes) / kBytesPerGb;
  double max_upload_gb = static_cast<double>(counts.assets.uploads.bytes_of_caller) / kBytesPerGb;
};

/// Of init and invite-admin.
struct SetUpFlags {
  std::vector<std::string> names;
  std::string admin = "admin";
  std::string store;  // empty: Flags::store, which has the variable's value
};

struct HealthFlags {
  std::string server = "localhost:7700";
  bool answers = false;
  double seconds = 5;
};

struct Flags {
  std::string data_dir;
  std::string store = "sqlite";
  std::string listen = "127.0.0.1:7700";
  std::string metrics_address;
  bool insecure = false;
  double certificate_hours = absl::ToDoubleHours(lumifold::access::kCredentialLifetime);
  double lease_seconds = 30.0;
  double heartbeat_seconds = 5.0;
  lumifold::logging::LogOptions log = {.name = "lumifold-server", .pattern = "%Y-%m-%dT%H:%M:%S.%e %l %v"};
  FarmFlags farm;
  PageFlags page;
  FilterFlags filter;
  DiskFlags disk;
  LimitFlags limits;
  lumifold::webhooks::WebhookOptions webhooks;
};

/// The subcommands, and their flags beside Flags.
struct Commands {
  CLI::App* recover = nullptr;
  CLI::App* init = nullptr;
  CLI::App* invite_admin = nullptr;
  CLI::App* health = nullptr;
  SetUpFlags set_up;
  HealthFlags probe;
};

/// Where it keeps jobs, and where others reach it.
void AddAddresses(CLI::App* app, Flags* flags) {
  app->add_option("--data", flags->data_dir,
                  "Folder for ledger, assets, film and results; created if missing")
      ->type_name("DIR");
  app->add_option("--store", flags->store,
                  "Ledger: sqlite (in the data folder) or postgresql://USER@HOST/DATABASE")
      ->type_name("STORE")
      ->envname(lumifold::ledger::kStoreVariable)
      ->capture_default_str();
  app->add_option("--listen", flags->listen, "Where to listen; port 0: a free port")
      ->type_name("HOST:PORT")
      ->capture_default_str();
  app->add_option("--advertise", flags->farm.advertise,
                  "Where others reach this coordinator, of several over one PostgreSQL database (default: by "
                  "--listen)")
      ->type_name("HOST:PORT");
  app->add_option("--failover-seconds", flags->farm.failover_seconds,
                  "Time without a sign of life after which another coordinator takes the jobs of this one")
      ->check(CLI::Range(0.5, 3600.0))
      ->capture_default_str();
  lumifold::monitoring::AddMetricsFlag(app, &flags->metrics_address);
  app->add_option("--page-address", flags->page.address,
                  "Show the status page at HOST:PORT, to those who have a link of 'lumifold page'; port 0: a "
                  "free port; off: nowhere")
      ->type_name("HOST:PORT")
      ->capture_default_str();
  app->add_option("--page-certificate", flags->page.certificate,
                  "PEM file with key and certificates of the status page off loopback (default: the "
                  "coordinator's own)")
      ->type_name("FILE");
  app->add_flag("--insecure", flags->insecure,
                "Allow listening off loopback without encryption, where 'init' has not been run");
  app->add_option("--certificate-hours", flags->certificate_hours,
                  "Lifetime of the certificates of server and workers; they are renewed before")
      ->check(CLI::Range(0.005, 24 * 365.0))
      ->capture_default_str();
}

void AddFilterFlags(CLI::App* app, FilterFlags* flags) {
  app->add_option("--filter-threads", flags->threads,
                  "Threads of the filter, of all its processes together (default: one for each core)")
      ->check(CLI::Range(1, 1024));
  app->add_option("--finish-processes", flags->processes,
                  "Frames that are finished at a time, each in a process; auto: as cores and memory allow "
                  "(default auto)")
      ->transform(CLI::Transformer(std::map<std::string, std::string>{{"auto", "0"}}))
      ->check(CLI::Range(0, 1024))
      ->option_text("N|auto");
  app->add_option("--filter-memory-mb", flags->memory_mb,
                  "Limit of the address space of a filter process in MiB; 0: none")
      ->capture_default_str();
  app->add_option("--filter-minutes", flags->minutes,
                  "Time after which the filter process of a frame is ended")
      ->check(CLI::Range(0.01, 1e6))
      ->capture_default_str();
  app->add_option(
         "--device", flags->device.word,
         "What filters beside the processor, with the same bits: auto (a GPU, if there is one), cpu, "
         "gpu, or gpu:N, number N of 'lumifold doctor'")
      ->check(lumifold::device::KnownDevice())
      ->type_name("DEVICE")
      ->capture_default_str();
  app->add_flag(
      "--allow-other-bits", flags->device.allows_other_bits,
      "Allow a GPU that rounds otherwise: pictures differ from others' in the last bits, their numeric "
      "class says so, and only workers with the same GPU finish frames");
}

void AddDiskFlags(CLI::App* app, DiskFlags* flags) {
  app->add_option("--keep-film-gb", flags->keep_film_gb,
                  "Units of finished frames that are kept for add-samples and retry, in GB; 0: none")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app->add_option("--keep-results-days", flags->keep_results_days,
                  "Days after which a job that has ended is deleted; 0: never")
      ->check(CLI::Range(0.0, 36500.0))
      ->capture_default_str();
  app->add_option("--quota-gb", flags->quota_gb,
                  "Limit of assets, units and results together, in GB; 0: none")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app->add_option("--reserve-mb", flags->reserve_mb,
                  "Disk space in MiB that is kept so that the ledger can be written when the disk is full")
      ->capture_default_str();
}

void AddWebhookFlags(CLI::App* app, lumifold::webhooks::WebhookOptions* options) {
  app->add_option(
         "--webhook-hosts", options->hosts,
         "Hosts whose webhooks may be called when jobs have ended, by http and https (default: none)")
      ->type_name("HOST[:PORT],...");
  app->add_option("--webhook-secret", options->secret_path,
                  "File whose first line signs these calls (default: DIR/webhook.secret, made if it is "
                  "missing)")
      ->type_name("FILE");
  app->add_option("--webhook-ca", options->ca_path,
                  "PEM file of the authorities of their certificates (default: the system's)")
      ->type_name("FILE");
}

void AddFlags(CLI::App* app, Flags* flags) {
  AddAddresses(app, flags);
  AddFilterFlags(app, &flags->filter);
  app->add_option("--lease-seconds", flags->lease_seconds,
                  "Time without a heartbeat after which leases expire")
      ->check(CLI::Range(0.1, 86400.0))
      ->capture_default_str();
  app->add_option("--heartbeat-seconds", flags->heartbeat_seconds, "Interval of the workers' heartbeats")
      ->check(CLI::Range(0.01, 3600.0))
      ->capture_default_str();
  AddDiskFlags(app, &flags->disk);
  AddWebhookFlags(app, &flags->webhooks);
  lumifold::logging::AddLogFlags(app, &flags->log);
  app->set_version_flag("--version", "lumifold-server " + std::string(lumifold::rpc::kVersion),
                        "Print the version and exit");
}

/// What callers may take.
void AddLimits(CLI::App* app, LimitFlags* flags) {
  app->add_option("--max-user-jobs", flags->counts.jobs.jobs_per_user, "Active jobs of one user")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app->add_option("--max-asset-gb", flags->max_asset_gb, "One file of a scene, in GB")
      ->check(CLI::Range(1e-6, 1e3))
      ->capture_default_str();
  app->add_option("--max-job-gb", flags->max_job_gb, "All files of a job, in GB")
      ->check(CLI::Range(1e-6, 1e6))
      ->capture_default_str();
  app->add_option("--max-upload-gb", flags->max_upload_gb,
                  "What uploads of one caller have announced and not sent, in GB")
      ->check(CLI::Range(1e-6, 1e6))
      ->capture_default_str();
  app->add_option(
         "--max-requests-per-second", flags->counts.calls.requests_per_second,
         "Calls of one person or, without access control, of one address; five times as many at once")
      ->check(CLI::Range(1.0, 1e6))
      ->capture_default_str();
  app->add_option("--max-connections-per-address", flags->counts.connections.connections_per_address,
                  "Connections of one address")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
}

void AddCommands(CLI::App* app, Flags* flags, Commands* commands) {
  commands->recover =
      app->add_subcommand(lumifold::server::kRecoverCommand,
                          "Rebuilds a lost or malformed ledger from the files of the data folder, then ends");
  commands->recover->add_option("--data", flags->data_dir, "The data folder")->type_name("DIR")->required();
  commands->init = app->add_subcommand(
      "init",
      "Makes certificates and the first codes, so that others can connect; prints what to type, then ends");
  commands->init
      ->add_option(
          "--name", commands->set_up.names,
          "A host name or IP address by which others reach it (default: this machine's name); may be "
          "repeated")
      ->type_name("NAME");
  commands->invite_admin = app->add_subcommand(
      "invite-admin", "Prints a code for 'lumifold login' as an administrator, then ends");
  commands->invite_admin->add_option("--name", commands->set_up.admin, "The administrator's name")
      ->type_name("NAME")
      ->capture_default_str();
  commands->health = app->add_subcommand(
      "health", "Asks a coordinator's health service, as probes of containers do; exit code 0 if it serves");
  commands->health
      ->add_option("--data", flags->data_dir, "Its data folder, for the certificate of its authority")
      ->type_name("DIR");
  commands->health->add_option("--server", commands->probe.server, "The coordinator")
      ->type_name("HOST:PORT")
      ->capture_default_str();
  commands->health->add_flag("--answers", commands->probe.answers,
                             "Exit code 0 also if it answers but does not serve, as while its disk is full");
  commands->health->add_option("--seconds", commands->probe.seconds, "Time to wait for the answer")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  for (CLI::App* command : {commands->init, commands->invite_admin}) {
    command->add_option("--data", flags->data_dir, "The data folder")->type_name("DIR")->required();
    command->add_option("--store", commands->set_up.store, "As without a command")->type_name("STORE");
  }
}

lumifold::server::Limits LimitsOf(const LimitFlags& flags) {
  constexpr double kBurst = 5;
  lumifold::server::Limits limits = flags.counts;
  limits.assets.asset_bytes = static_cast<uint64_t>(flags.max_asset_gb * kBytesPerGb);
  limits.jobs.job_asset_bytes = static_cast<uint64_t>(flags.max_job_gb * kBytesPerGb);
  limits.assets.uploads.bytes_of_caller = static_cast<uint64_t>(flags.max_upload_gb * kBytesPerGb);
  limits.calls.request_burst = kBurst * limits.calls.requests_per_second;
  return limits;
}

/// Blocks SIGTERM and SIGINT in this thread and the threads it starts, so that only sigwait receives them.
sigset_t BlockEndSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, kExpelled);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  signal(SIGPIPE, SIG_IGN);
  return signals;
}

/// The limit of open files is low for the sake of programs that use select(2); this one does not.
void RaiseFileLimit() {
  rlimit limit = {};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
}

/// Waits for one of the signals, and tells the service manager meanwhile that the coordinator works.
int AwaitSignal(lumifold::server::Server& server, const sigset_t& signals, ServiceManager* manager) {
  int received = 0;
  if (manager->alive_interval() == absl::InfiniteDuration()) {
    sigwait(&signals, &received);
    return received;
  }
  const timespec pause = absl::ToTimespec(manager->alive_interval());
  while (received <= 0) {
    server.Check()
        .IgnoreError();  // it hangs where the coordinator does; a storage that fails is no reason to end it
    manager->Alive();
    received = sigtimedwait(&signals, nullptr, &pause);
  }
  return received;
}

/// Runs a coordinator until a signal ends it. One whose jobs others have taken, as it gave no sign of life
/// for a while, starts anew with nothing of what it knew.
int Serve(lumifold::server::ServerOptions options, const sigset_t& end_signals, ServiceManager* manager) {
  const std::string host = options.listen.substr(0, options.listen.rfind(':'));
  bool is_first = true;
  while (true) {
    absl::StatusOr<std::unique_ptr<lumifold::server::Server>> server =
        lumifold::server::Server::Start(options);
    if (!is_first && absl::IsUnavailable(server.status())) {  // it was cut off, and may still be
      options.log->warn("event=not_started error={}", lumifold::logging::Quoted(server.status().message()));
      const int received = sigtimedwait(&end_signals, nullptr, &kStartPause);
      if (received == SIGTERM || received == SIGINT) return 0;
      continue;
    }
    if (!server.ok()) {
      std::cerr << "lumifold-server: " << std::string(server.status().message()) << '\n';
      return kExitFailure;
    }
    options.listen = absl::StrCat(host, ":", (*server)->port());
    if (std::exchange(is_first, false)) std::cout << "listening on " << options.listen << '\n' << std::flush;
    manager->Ready(absl::StrCat("listening on ", options.listen));
    const int received = AwaitSignal(**server, end_signals, manager);
    options.log->info("event=stopping signal={}", received);
    manager->Stopping();
    (*server)->Shutdown();
    server->reset();
    options.log->info("event=stopped");
    if (received != kExpelled) return 0;
  }
}

/// The device for frames, blocks and previews; null: the processor.
absl::StatusOr<std::shared_ptr<lumifold::device::DeviceProcess>> OpenDevice(
    const FilterFlags& flags, const std::shared_ptr<spdlog::logger>& log) {
  absl::StatusOr<std::unique_ptr<lumifold::device::DeviceProcess>> device =
      lumifold::device::DeviceProcess::Start({.choice = flags.device, .warn = [log](const std::string& line) {
                                                log->warn("event=device_warning error={}",
                                                          lumifold::logging::Quoted(line));
                                              }});
  if (!device.ok()) return device.status();
  if (*device != nullptr) log->info("event=device name={}", lumifold::logging::Quoted((*device)->name()));
  return *std::move(device);
}

int RunServer(const Flags& flags) {
  umask(077);  // SQLite makes the ledger's files by itself
  if (lumifold::access::HasAccessFolder(lumifold::server::DataFolder(flags.data_dir).AccessPath()) ||
      !flags.webhooks.hosts.empty())
    lumifold::identity::ProtectMemory();
  const sigset_t end_signals = BlockEndSignals();
  RaiseFileLimit();
  const std::shared_ptr<spdlog::logger> log = lumifold::logging::MakeNonblockingLogger(flags.log);
  lumifold::server::ServerOptions options;
  options.data.folder = flags.data_dir;
  options.data.store = flags.store;
  options.listen = flags.listen;
  options.metrics_address = flags.metrics_address;
  if (flags.page.address != "off") options.page.address = flags.page.address;
  options.page.certificate = flags.page.certificate;
  options.security.insecure = flags.insecure;
  options.security.certificate_lifetime = absl::Hours(flags.certificate_hours);
  options.lease = absl::Seconds(flags.lease_seconds);
  options.heartbeat = absl::Seconds(flags.heartbeat_seconds);
  options.filter.threads = flags.filter.threads;
  options.filter.processes = flags.filter.processes;
  options.filter.in_child_process = true;
  options.filter.memory_limit_bytes = flags.filter.memory_mb << 20;
  options.filter.time_limit = absl::Minutes(flags.filter.minutes);
  absl::StatusOr<std::shared_ptr<lumifold::device::DeviceProcess>> device = OpenDevice(flags.filter, log);
  if (!device.ok()) {
    std::cerr << "lumifold-server: --device: " << std::string(device.status().message()) << '\n';
    return kExitFailure;
  }
  options.filter.device_process = *std::move(device);
  options.data.storage.reserve_bytes = flags.disk.reserve_mb << 20;
  options.data.retention.film_bytes = static_cast<uint64_t>(flags.disk.keep_film_gb * kBytesPerGb);
  if (flags.disk.keep_results_days > 0)
    options.data.retention.keep_results = absl::Hours(24 * flags.disk.keep_results_days);
  if (flags.disk.quota_gb > 0)
    options.data.retention.quota_bytes = static_cast<uint64_t>(flags.disk.quota_gb * kBytesPerGb);
  options.limits = LimitsOf(flags.limits);
  options.security.webhooks = flags.webhooks;
  options.log = log;
  options.farm.advertise = flags.farm.advertise;
  options.farm.failover = absl::Seconds(flags.farm.failover_seconds);
  options.farm.on_expelled = [] { kill(getpid(), kExpelled); };
  ServiceManager manager;
  return Serve(std::move(options), end_signals, &manager);
}

/// Prints what a subcommand has done, or its error.
int Report(const absl::StatusOr<std::string>& report) {
  if (!report.ok()) {
    std::cerr << "lumifold-server: " << std::string(report.status().message()) << '\n';
    return kExitFailure;
  }
  std::cout << *report << std::flush;
  return 0;
}

int RunRecover(const std::string& data_dir) {
  return Report(lumifold::server::RecoverLedger(lumifold::server::DataFolder(data_dir)));
}

lumifold::access::AccessOptions AccessOptionsOf(const Flags& flags, const SetUpFlags& set_up) {
  lumifold::identity::ProtectMemory();
  return {.folder = lumifold::server::DataFolder(flags.data_dir).AccessPath(),
          .store = set_up.store.empty() ? flags.store : set_up.store,
          .certificate_lifetime = absl::Hours(flags.certificate_hours),
          .wall_now = lumifold::identity::ValidityClock,
          .log = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::null_sink_mt>())};
}

int RunInit(const Flags& flags, const SetUpFlags& set_up) {
  return Report(lumifold::access::SetUp(AccessOptionsOf(flags, set_up), flags.data_dir, set_up.names));
}

int RunHealth(const std::string& data_dir, const HealthFlags& flags) {
  const std::string access = lumifold::server::DataFolder(data_dir).AccessPath();
  lumifold::server::HealthCheckOptions options{.address = flags.server, .answers_only = flags.answers};
  if (!data_dir.empty() && lumifold::access::HasAccessFolder(access))
    options.security.ca_path = access + "/ca.pem";
  options.timeout = absl::Seconds(flags.seconds);
  const absl::Status health = lumifold::server::CheckHealth(options);
  if (health.ok()) return Report("ok\n");
  return Report(health);
}

int RunInviteAdmin(const Flags& flags, const SetUpFlags& set_up) {
  absl::StatusOr<std::string> code =
      lumifold::access::InviteAdmin(AccessOptionsOf(flags, set_up), set_up.admin);
  if (code.ok()) code->push_back('\n');
  return Report(code);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == lumifold::server::kFinishFrameCommand) {
    return lumifold::server::RunFinishFrameProcess({argv + 2, argv + argc});
  }
  if (argc > 1 && std::string(argv[1]) == lumifold::server::kMakePreviewCommand) {
    return lumifold::server::RunMakePreviewProcess({argv + 2, argv + argc});
  }
  if (argc > 1 && std::string(argv[1]) == lumifold::device::kDeviceCommand)
    return lumifold::device::RunDeviceProcess({argv + 2, argv + argc});
  // gRPC logs to standard error by default; errors reach us as a Status. The user can set the variable.
  setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);
  // So does protobuf, a line for each malformed message: anyone could fill the disk.
  google::protobuf::SetLogHandler(nullptr);
  CLI::App app(
      "Lumifold's coordinator: accepts jobs, leases units to workers, commits units, assembles and filters "
      "frames, serves results.",
      "lumifold-server");
  lumifold::service::SetHelpStyle(&app);
  Flags flags;
  AddFlags(&app, &flags);
  AddLimits(&app, &flags.limits);
  Commands commands;
  AddCommands(&app, &flags, &commands);
  app.footer(
      "Example: lumifold-server --data farm --listen 0.0.0.0:7700\n"
      "Off loopback it needs 'lumifold-server init --data farm' before, or --insecure.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& success) {
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    std::cerr << "lumifold-server: " << error.what() << '\n';
    return kExitUsage;
  }
  if (commands.recover->parsed()) return RunRecover(flags.data_dir);
  if (commands.init->parsed()) return RunInit(flags, commands.set_up);
  if (commands.invite_admin->parsed()) return RunInviteAdmin(flags, commands.set_up);
  if (commands.health->parsed()) lumifold::threads::EndProcess(RunHealth(flags.data_dir, commands.probe));
  if (flags.data_dir.empty()) {
    std::cerr << "lumifold-server: --data is required\n";
    return kExitUsage;
  }
  lumifold::threads::EndProcess(RunServer(flags));
}
