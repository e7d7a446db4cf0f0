#include <pwd.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "filter/image/memory.h"
#include "filter/opencl/open_device.h"
#include "proto/device/device_process.h"
#include "proto/device/serve_device.h"
#include "proto/identity/certificate.h"
#include "proto/identity/join.h"
#include "proto/identity/profile.h"
#include "proto/identity/secrets.h"
#include "proto/logging/fields.h"
#include "proto/logging/last_words.h"
#include "proto/logging/log_flags.h"
#include "proto/logging/nonblocking_log.h"
#include "proto/monitoring/endpoint.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/endpoints.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/version.h"
#include "proto/sandbox/sandbox.h"
#include "proto/service/help_style.h"
#include "proto/service/service_manager.h"
#include "proto/threads/end_process.h"
#include "proto/threads/event.h"
#include "spdlog/spdlog.h"
#include "worker/availability/availability.h"
#include "worker/cache/asset_folder.h"
#include "worker/connection/certificate_renewal.h"
#include "worker/connection/connection.h"
#include "worker/leases/worker_log.h"
#include "worker/render/renderer.h"
#include "worker/worker_flags.h"

namespace {

namespace sandbox = lumifold::sandbox;
using lumifold::worker::AddFlags;
using lumifold::worker::Flags;
using lumifold::worker::TimeFlags;

constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;
constexpr int kExitNotAdmitted = 3;
constexpr int kExitNotReached = 4;
constexpr int kExitInterrupted = 128 + SIGINT;  // as shells say it
constexpr char kDefaultServer[] = "127.0.0.1:7700";

/// Notifies `leave` on the first SIGINT or SIGTERM. A SIGINT after that, of somebody who does not want to
/// wait, ends the process; further SIGTERMs do not, because cluster engines send several. The signals are
/// blocked in all threads and received by sigwait, so that no code runs in a signal handler.
std::thread WatchSignals(lumifold::threads::Event* leave) {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  signal(SIGPIPE, SIG_IGN);  // a log without a reader must not end the worker
  return std::thread([set, leave] {
    int received = 0;
    sigwait(&set, &received);
    leave->Notify();
    do {
      sigwait(&set, &received);
    } while (received != SIGINT);
    _exit(kExitInterrupted);
  });
}

/// The error of the tags of --tags; empty if they are valid.
std::string TagsError(const std::vector<std::string>& tags) {
  if (tags.size() > lumifold::rpc::kMaxTags)
    return absl::StrCat("at most ", lumifold::rpc::kMaxTags, " tags");
  for (const std::string& tag : tags) {
    if (tag.empty() || tag.size() > lumifold::rpc::kMaxTagBytes)
      return absl::StrCat("'", tag, "': a tag has 1 to ", lumifold::rpc::kMaxTagBytes, " bytes");
  }
  return "";
}

/// Files and sockets of gRPC and the log; a coordinator and its names need a few dozen.
constexpr uint64_t kMaxOpenFiles = 1024;
/// A worker writes no files but its log, its certificate and the assets of --asset-cache; larger ones are not
/// kept there.
constexpr uint64_t kMaxFileBytes = uint64_t{16} << 30;
constexpr uint16_t kDnsPort = 53;

/// The ports of the coordinators and of name servers; none, for all, where gRPC goes through a proxy or an
/// address has no port.
std::vector<uint16_t> PortsOf(const std::vector<std::string>& servers) {
  for (const char* proxy : {"grpc_proxy", "https_proxy", "http_proxy"}) {
    if (std::getenv(proxy) != nullptr) return {};
  }
  std::vector<uint16_t> ports = {kDnsPort};
  for (const std::string& server : servers) {
    lumifold::rpc::HostAndPort parsed;
    if (!lumifold::rpc::ParseHostAndPort(server, &parsed).ok()) return {};
    ports.push_back(static_cast<uint16_t>(parsed.port));
  }
  return ports;
}

void LogSandbox(const Flags& flags, const sandbox::SandboxReport& report, spdlog::logger& log) {
  if (flags.sandbox.off) {
    log.warn(
        "event=no_sandbox meaning=\"--no-sandbox was given: a malformed scene that takes over this worker "
        "can do "
        "whatever user {} can\"",
        getuid());
    return;
  }
  log.info("event=sandbox up={}", lumifold::logging::Quoted(absl::StrJoin(report.up, ", ")));
  if (!report.lacking.empty())
    log.warn("event=sandbox_lacks what={}", lumifold::logging::Quoted(absl::StrJoin(report.lacking, ", ")));
}

int Fail(const absl::Status& status) {
  std::fprintf(stderr, "lumifold-worker: %s\n", std::string(status.message()).c_str());
  return kExitFailure;
}

int RunEnroll(const Flags& flags) {
  lumifold::identity::ProtectMemory();
  const absl::StatusOr<std::string> code =
      lumifold::identity::ReadCode(flags.code, &std::cin, isatty(STDIN_FILENO) == 1 ? &std::cerr : nullptr);
  if (!code.ok()) return Fail(code.status());
  const std::string profile = flags.profile.empty() ? lumifold::identity::kDefaultProfile : flags.profile;
  const absl::StatusOr<lumifold::v1::CertificateResponse> enrolled = lumifold::identity::Enroll(
      lumifold::identity::Profiles(lumifold::identity::ProfilesFolder()), profile, flags.server, *code);
  if (!enrolled.ok()) return Fail(enrolled.status());
  std::fprintf(stderr, "lumifold-worker: enrolled at %s as %s; profile '%s'\n", flags.server.c_str(),
               enrolled->name().c_str(), profile.c_str());
  return 0;
}

/// Where the worker connects to, and as whom.
struct Target {
  std::vector<std::string> servers;
  std::string profile;  // empty: none
  std::string folder;   // of the profile
  lumifold::rpc::Security security;
};
absl::StatusOr<Target> FindTarget(const Flags& flags, const lumifold::identity::Profiles& profiles) {
  const absl::StatusOr<std::optional<std::string>> chosen =
      profiles.Choose(flags.profile, flags.server, lumifold::identity::Profile::Kind::kWorker);
  if (!chosen.ok()) return chosen.status();
  std::string list = flags.server.empty() ? kDefaultServer : flags.server;
  Target target;
  target.security.insecure = flags.insecure;
  if (const std::optional<std::string>& name = *chosen; name.has_value()) {
    lumifold::identity::ProtectMemory();
    const absl::StatusOr<lumifold::identity::Profile> profile = profiles.Read(*name);
    if (!profile.ok()) return profile.status();
    absl::StatusOr<lumifold::rpc::Security> security = profiles.SecurityOf(*name);
    if (!security.ok()) return security.status();
    if (flags.server.empty()) list = profile->server;
    target.profile = *name;
    target.folder = profiles.FolderOf(*name);
    target.security = *std::move(security);
  }
  absl::StatusOr<std::vector<std::string>> servers = lumifold::rpc::ParseEndpoints(list);
  if (!servers.ok()) return servers.status();
  target.servers = *std::move(servers);
  for (const std::string& server : target.servers) {
    if (absl::Status status = lumifold::rpc::CheckServerAddress(server, target.security); !status.ok())
      return status;
  }
  return target;
}

/// The user that a worker becomes when started as root: with a profile its owner, who must be able to renew
/// it.
absl::StatusOr<std::string> UserFor(const Flags& flags, const Target& target) {
  if (target.folder.empty() || geteuid() != 0) return flags.sandbox.user;
  struct stat info = {};
  const passwd* const owner = stat(target.folder.c_str(), &info) == 0 ? getpwuid(info.st_uid) : nullptr;
  if (owner == nullptr)
    return absl::FailedPreconditionError(absl::StrCat(target.folder, ": belongs to no known user"));
  return owner->pw_name;
}

/// Makes the folder of --asset-cache, before the sandbox, which opens what is there.
absl::Status PrepareAssetCache(const Flags& flags, const Target& target) {
  if (flags.asset_cache.folder.empty()) return absl::OkStatus();
  const absl::StatusOr<std::string> user = UserFor(flags, target);
  if (!user.ok()) return user.status();
  const passwd* const becomes = geteuid() == 0 && !flags.sandbox.off ? getpwnam(user->c_str()) : nullptr;
  return lumifold::worker::MakeAssetFolder(flags.asset_cache.folder,
                                           becomes == nullptr ? geteuid() : becomes->pw_uid);
}

/// Listens where metrics are to be shown; nullopt: nowhere. Before the sandbox, in which nothing may listen
/// any more.
absl::StatusOr<std::optional<lumifold::monitoring::EndpointSockets>> ListenForMetrics(const Flags& flags) {
  if (flags.metrics_address.empty()) return std::nullopt;
  absl::StatusOr<lumifold::monitoring::EndpointSockets> sockets =
      lumifold::monitoring::ListenForMetrics(flags.metrics_address);
  if (!sockets.ok()) return sockets.status();
  return *std::move(sockets);
}

uint64_t AddressSpaceOf(const Flags& flags) {
  if (flags.sandbox.off) return 0;
  return flags.sandbox.memory_mb.has_value() ? *flags.sandbox.memory_mb << 20
                                             : sandbox::DefaultMemoryBytes(flags.threads);
}

/// Memory that the worker may use, for the coordinator. Before the sandbox.
/// Errors: kResourceExhausted where not even a small scene would fit.
absl::StatusOr<uint64_t> FindMemory(const Flags& flags) {
  constexpr uint64_t kLeast = uint64_t{128} << 20;
  constexpr uint64_t kBytesOfAnArena = uint64_t{1} << 30;
  const uint64_t address_space = AddressSpaceOf(flags);
  const uint64_t bytes = sandbox::MemoryOfThisProcess(address_space, flags.threads);
  if (bytes < sandbox::UsableMemoryBytes())  // by a limit of addresses
    lumifold::UseArenas(static_cast<int>(std::clamp<uint64_t>(bytes / kBytesOfAnArena, 1, 1024)));
  if (bytes >= kLeast) return bytes;
  return absl::ResourceExhaustedError(
      absl::StrCat("not enough memory: ", bytes >> 20, " MiB are left for scenes beside ", flags.threads,
                   " threads, and a worker needs ", kLeast >> 20,
                   " (ulimit -v, --memory-mb, --threads, the control group)"));
}

lumifold::worker::FinishPlaces PlacesOf(const Flags& flags, uint64_t memory_bytes,
                                        std::shared_ptr<lumifold::filter::FilterDevice> device) {
  if (flags.finish == "never") return {};
  if (flags.finish == "only")
    return {.count = flags.threads, .memory_bytes = memory_bytes, .device = std::move(device)};
  // The rest is for scenes.
  return {.count = flags.threads,
          .memory_bytes = memory_bytes / 2,
          .keep_bytes = memory_bytes / 8,
          .device = std::move(device)};
}

/// The device for frames. Its process is outside the sandbox, so it starts before.
/// `log` is where its failure is told, once there is one.
absl::StatusOr<lumifold::filter::OpenedDevice> OpenDevice(const Flags& flags, const Target& target,
                                                          const std::shared_ptr<spdlog::logger>* log) {
  if (flags.finish == "never") return lumifold::filter::OpenedDevice{};
  const absl::StatusOr<std::string> user = UserFor(flags, target);
  if (!user.ok()) return user.status();
  absl::StatusOr<lumifold::filter::OpenedDevice> device = lumifold::device::OpenDevice(
      {.choice = flags.device,
       .user = flags.sandbox.off ? "" : *user,
       .warn = [log](const std::string& line) {
         if (*log != nullptr) (*log)->warn("event=device_warning error={}", lumifold::logging::Quoted(line));
       }});
  if (device.ok()) return device;
  return absl::Status(device.status().code(), absl::StrCat("--device: ", device.status().message()));
}

/// Enters the sandbox, before any thread starts: it holds only for threads that start later.
absl::StatusOr<sandbox::SandboxReport> EnterSandbox(const Flags& flags, const Target& target) {
  if (flags.sandbox.off) return sandbox::SandboxReport();
  const absl::StatusOr<std::string> user = UserFor(flags, target);
  if (!user.ok()) return user.status();
  sandbox::SandboxOptions options;
  options.user = *user;
  options.memory_bytes = AddressSpaceOf(flags);
  options.open_files = kMaxOpenFiles;
  options.file_bytes = kMaxFileBytes;
  if (!target.folder.empty()) options.writable = {target.folder};  // its certificate is renewed there
  if (!flags.asset_cache.folder.empty()) options.writable.push_back(flags.asset_cache.folder);
  options.network = true;
  options.accepts = !flags.metrics_address.empty();
  options.connect_ports = PortsOf(target.servers);
  return sandbox::EnterSandbox(options);
}

/// Why the worker rests, by --hours and --only-idle; null: it never does. Before the sandbox, in which
/// neither the time zone nor the load of the machine can be read.
absl::StatusOr<std::function<std::string()>> MakeRestReason(const TimeFlags& flags) {
  if (!flags.hours.has_value() && !flags.only_idle.has_value()) return std::function<std::string()>();
  lumifold::worker::AvailabilityOptions options = {.hours = flags.hours,
                                                   .zone = absl::LocalTimeZone(),
                                                   .wall_now = lumifold::identity::ValidityClock,
                                                   .max_load = flags.only_idle,
                                                   .now = lumifold::rpc::MonotonicNow};
  if (flags.only_idle.has_value()) {
    absl::StatusOr<std::unique_ptr<lumifold::worker::CpuClock>> clock = lumifold::worker::CpuClock::Open();
    if (!clock.ok()) return clock.status();
    options.cpu = [cpu = std::shared_ptr<lumifold::worker::CpuClock>(*std::move(clock))] {
      return cpu->Read();
    };
  }
  const auto availability = std::make_shared<lumifold::worker::Availability>(std::move(options));
  return std::function<std::string()>([availability] { return availability->RestReason(); });
}

absl::StatusOr<std::shared_ptr<grpc::Channel>> Connect(const std::string& address,
                                                       const lumifold::rpc::Security& security) {
  if (absl::Status status = lumifold::rpc::CheckServerAddress(address, security); !status.ok()) return status;
  return lumifold::rpc::MakeChannel(address, security, lumifold::rpc::kQuickKeepAlive);
}

void LogStart(const Flags& flags, const Target& target, uint64_t memory_bytes, const absl::Status& has_cache,
              const lumifold::filter::OpenedDevice& device, spdlog::logger& log) {
  const std::string other_bits = device.device == nullptr ? "" : device.device->OtherBits();
  log.info("event=start name={} server={} threads={} memory_mb={} class={}",
           lumifold::logging::OneWord(flags.name), absl::StrJoin(target.servers, ","), flags.threads,
           memory_bytes >> 20, lumifold::render::NumericClass(other_bits));
  if (!device.name.empty()) log.info("event=device name={}", lumifold::logging::Quoted(device.name));
  if (!has_cache.ok())  // what is cached is a convenience: it works without
    log.warn("event=no_asset_cache error={}", lumifold::logging::Quoted(has_cache.message()));
}

lumifold::worker::WorkerLog MakeLog(const Flags& flags, const std::string& name) {
  if (flags.log.format == "json") setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);  // its lines are no JSON
  lumifold::worker::WorkerLog log =
      lumifold::worker::MakeWorkerLog(lumifold::logging::MakeNonblockingLogger(flags.log));
  log.labels->SetWorker("-/" + name);  // it has no id yet
  return log;
}

/// Tells why the worker ends with an error, and its exit code.
int ExitCodeOf(const absl::Status& status, spdlog::logger& log) {
  if (absl::IsUnauthenticated(status) || absl::IsPermissionDenied(status)) {
    log.error("event=not_admitted error={}", lumifold::logging::Quoted(status.message()));
    std::fprintf(stderr, "lumifold-worker: %s. The worker needs a new code: 'lumifold-worker enroll'\n",
                 std::string(status.message()).c_str());
    return kExitNotAdmitted;
  }
  if (absl::IsDeadlineExceeded(status)) {
    log.error("event=not_reached error={}", lumifold::logging::Quoted(status.message()));
    Fail(status);
    return kExitNotReached;
  }
  return Fail(status);
}

absl::Status Work(const Target& target, const lumifold::worker::WorkerOptions& options) {
  const lumifold::threads::Event never;
  return lumifold::worker::RunWorker(
      {.addresses = target.servers,
       .connect = [&target](const std::string& address) { return Connect(address, target.security); }},
      options, never);
}

int RunWorkerProcess(const Flags& flags) {
  const absl::Time start = lumifold::rpc::MonotonicNow();
  if (absl::Status status = sandbox::YieldToOthers(flags.niceness); !status.ok()) return Fail(status);
  const lumifold::identity::Profiles profiles(lumifold::identity::ProfilesFolder());
  const absl::StatusOr<Target> target = FindTarget(flags, profiles);
  if (!target.ok()) return Fail(target.status());
  const absl::Status has_cache = PrepareAssetCache(flags, *target);
  const auto listens = ListenForMetrics(flags);
  if (!listens.ok()) return Fail(listens.status());
  const std::optional<lumifold::monitoring::EndpointSockets>& metrics = *listens;
  const auto rest_reason = MakeRestReason(flags.times);
  if (!rest_reason.ok()) return Fail(rest_reason.status());
  const absl::StatusOr<uint64_t> memory_bytes = FindMemory(flags);
  if (!memory_bytes.ok()) return Fail(memory_bytes.status());
  std::shared_ptr<spdlog::logger> device_log;
  const auto device = OpenDevice(flags, *target, &device_log);
  if (!device.ok()) return Fail(device.status());
  lumifold::service::ServiceManager manager;  // before the sandbox, which lets no program open its socket
  const absl::StatusOr<sandbox::SandboxReport> sandboxed = EnterSandbox(flags, *target);
  if (!sandboxed.ok()) return Fail(sandboxed.status());
  lumifold::threads::Event leave;
  WatchSignals(&leave).detach();  // before any other thread, which would take the signals
  const std::string name = lumifold::logging::OneWord(flags.name);
  const lumifold::worker::WorkerLog worker_log = MakeLog(flags, name);
  const std::shared_ptr<spdlog::logger>& log = worker_log.log;
  device_log = log;
  LogSandbox(flags, *sandboxed, *log);
  LogStart(flags, *target, *memory_bytes, has_cache, *device, *log);
  if (metrics.has_value()) log->info("event=metrics address={}", metrics->address);
  const lumifold::worker::CertificateRenewal renewal({.profiles = profiles,
                                                      .profile = target->profile,
                                                      .wall_now = lumifold::identity::ValidityClock,
                                                      .log = log});
  // From now on it takes leases, or tries to reach a coordinator for as long as it takes.
  manager.Ready(absl::StrCat("worker of ", absl::StrJoin(target->servers, ",")));
  const lumifold::worker::WorkerOptions options{
      .name = flags.name,
      .threads = flags.threads,
      .tags = flags.tags,
      .memory_bytes = *memory_bytes,
      .renders = flags.finish != "only",
      .finishing = PlacesOf(flags, *memory_bytes, device->device),
      .log = worker_log,
      .assets = {.folder = has_cache.ok() ? flags.asset_cache.folder : "",
                 .max_bytes = flags.asset_cache.gb << 30},
      .leave = &leave,
      .drain = absl::Seconds(flags.times.drain_seconds),
      .rest_reason = *rest_reason,
      .check_identity = [&renewal] { return renewal.CheckNotExpired(); },
      .exit_when_idle = absl::Seconds(flags.times.exit_when_idle_seconds),
      .alive = [&manager] { manager.Alive(); },
      .metrics = metrics.has_value() ? &*metrics : nullptr,
  };
  const absl::Status status = Work(*target, options);
  manager.Stopping();
  if (!status.ok()) return ExitCodeOf(status, *log);
  log->info("event=stop name={} threads={} seconds={:.3f}", name, flags.threads,
            absl::ToDoubleSeconds(lumifold::rpc::MonotonicNow() - start));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == lumifold::device::kDeviceCommand)
    return lumifold::device::RunDeviceProcess({argv + 2, argv + argc});
  lumifold::logging::SayLastWords("lumifold-worker");
  CLI::App app(
      "Renders units for a Lumifold coordinator. SIGINT or SIGTERM lets it finish or hand back its units and "
      "leave; "
      "a SIGINT after that ends it at once.",
      "lumifold-worker");
  lumifold::service::SetHelpStyle(&app);
  Flags flags;
  AddFlags(&app, &flags);
  CLI::App* enroll =
      app.add_subcommand("enroll", "Gets a certificate from a coordinator with a code, then ends");
  enroll->add_option("SERVER", flags.server, "The coordinator, HOST:PORT")->required();
  enroll->add_option(
      "CODE", flags.code,
      "From 'lumifold invite --worker'; without it, or with '-', it is read from standard input");
  enroll->add_option("--profile", flags.profile, "Where to keep key and certificate (default: default)")
      ->type_name("NAME");
  std::string problem;
  try {
    app.parse(argc, argv);
    if (const std::string error = TagsError(flags.tags); !error.empty()) problem = "--tags: " + error;
  } catch (const CLI::Success& success) {
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    problem = error.what();
  }
  if (problem.empty())
    lumifold::threads::EndProcess(enroll->parsed() ? RunEnroll(flags) : RunWorkerProcess(flags));
  std::fprintf(stderr, "lumifold-worker: %s\n", problem.c_str());
  return kExitUsage;
}
