#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/nonblocking_log.h"
#include "proto/rpc/version.h"
#include "spdlog/spdlog.h"
#include "worker/connection.h"
#include "worker/fence/fence.h"
#include "worker/render/renderer.h"

namespace {

namespace fence = lumifold::fence;

constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;
constexpr int kExitSignal = 128;  // plus the number of the signal, as shells say it

std::string DefaultName() {
  char host[256] = "worker";
  gethostname(host, sizeof(host) - 1);
  return absl::StrCat(host, ":", getpid());
}

/// Notifies `leave` on the first SIGINT or SIGTERM and ends the process on the second. The signals are blocked in all
/// threads and received by sigwait, so that no code runs in a signal handler.
std::thread WatchSignals(lumifold::rpc::MonotonicEvent* leave) {
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
    sigwait(&set, &received);
    _exit(kExitSignal + received);
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

struct Flags {
  std::string server = "127.0.0.1:7700";
  std::string name = DefaultName();
  std::string log_level = "info";
  int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  std::vector<std::string> tags;
  double drain_seconds = 30;
  double exit_when_idle_seconds = std::numeric_limits<double>::infinity();
  std::string user = fence::DefaultUser();
  std::optional<uint64_t> memory_mb;  // default: by the machine
  bool no_fence = false;
};

void AddFlags(CLI::App* app, Flags* flags) {
  app->add_option("--server", flags->server, "Coordinator, HOST:PORT")->capture_default_str();
  app->add_option("--threads", flags->threads, "Number of units rendered at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app->add_option("--name", flags->name, "Name in the coordinator's log")->capture_default_str();
  app->add_option("--tags", flags->tags, "What the machine has or may be used for: gpu,night")
      ->delimiter(',');
  app->add_option("--drain-seconds", flags->drain_seconds,
                  "After SIGINT or SIGTERM: time to finish the units being rendered")
      ->check(CLI::Range(0.0, 86400.0))
      ->capture_default_str();
  app->add_option("--exit-when-idle", flags->exit_when_idle_seconds,
                  "Seconds without a unit after which the worker ends (default: never)")
      ->check(CLI::Range(0.0, 1e9));
  app->add_option("--memory-mb", flags->memory_mb,
                  "Limit of the address space in MiB; 0: none (default: the machine's memory and a reserve)");
  app->add_option("--user", flags->user, "User to become when started as root; root: stay")
      ->capture_default_str();
  app->add_flag("--no-fence", flags->no_fence,
                "For debugging: no limits, all files, all system calls, and root stays root");
  app->add_option("--log-level", flags->log_level, "Minimum level of the log on standard error")
      ->check(CLI::IsMember({"debug", "info", "warn", "error", "off"}))
      ->capture_default_str();
  app->set_version_flag("--version", absl::StrCat("lumifold-worker ", std::string(lumifold::rpc::kVersion),
                                                  " (numeric class ", lumifold::render::NumericClass(), ")"));
}

/// Files and sockets of gRPC and the log; a coordinator and its names need a few dozen.
constexpr uint64_t kMaxOpenFiles = 1024;
/// A worker writes no file but its log.
constexpr uint64_t kMaxFileBytes = uint64_t{16} << 30;
constexpr uint16_t kDnsPort = 53;

/// The ports of the coordinator and of name servers; none, for all, where gRPC goes through a proxy or the address has
/// no port.
std::vector<uint16_t> PortsOf(const std::string& server) {
  for (const char* proxy : {"grpc_proxy", "https_proxy", "http_proxy"}) {
    if (std::getenv(proxy) != nullptr) return {};
  }
  uint32_t port = 0;
  const size_t colon = server.rfind(':');
  const bool has_port = colon != std::string::npos && absl::SimpleAtoi(server.substr(colon + 1), &port) &&
                        port > 0 && port <= std::numeric_limits<uint16_t>::max();
  if (!has_port) return {};
  return {static_cast<uint16_t>(port), kDnsPort};
}

absl::StatusOr<fence::FenceReport> EnterFence(const Flags& flags) {
  return fence::EnterFence({
      .user = flags.user,
      .memory_bytes =
          flags.memory_mb.has_value() ? *flags.memory_mb << 20 : fence::DefaultMemoryBytes(flags.threads),
      .open_files = kMaxOpenFiles,
      .file_bytes = kMaxFileBytes,
      .network = true,
      .connect_ports = PortsOf(flags.server),
  });
}

void LogFence(const Flags& flags, const fence::FenceReport& report, spdlog::logger& log) {
  if (flags.no_fence) {
    log.warn(
        "event=no_fence: --no-fence was given: a malformed scene that takes over this worker can do whatever "
        "user {} "
        "can",
        getuid());
    return;
  }
  log.info("event=fence up=\"{}\"", absl::StrJoin(report.up, ", "));
  if (!report.lacking.empty()) log.warn("event=fence_lacks what=\"{}\"", absl::StrJoin(report.lacking, ", "));
}

int RunWorkerProcess(const Flags& flags) {
  // Before any thread starts: the fence holds only for threads that start later.
  absl::StatusOr<fence::FenceReport> fenced = fence::FenceReport();
  if (!flags.no_fence) fenced = EnterFence(flags);
  if (!fenced.ok()) {
    std::fprintf(stderr, "lumifold-worker: %s\n", std::string(fenced.status().message()).c_str());
    return kExitFailure;
  }
  lumifold::rpc::MonotonicEvent leave;
  const lumifold::rpc::MonotonicEvent never;
  WatchSignals(&leave).detach();  // before any other thread, which would take the signals
  const std::shared_ptr<spdlog::logger> log =
      lumifold::rpc::MakeNonblockingLogger({.name = "worker", .level = flags.log_level});
  LogFence(flags, *fenced, *log);
  log->info("event=start name={} server={} threads={} class={}", flags.name, flags.server, flags.threads,
            lumifold::render::NumericClass());
  lumifold::worker::WorkerOptions options{
      .name = flags.name,
      .threads = flags.threads,
      .tags = flags.tags,
      .log = log,
      .leave = &leave,
      .drain = absl::Seconds(flags.drain_seconds),
      .exit_when_idle = absl::Seconds(flags.exit_when_idle_seconds),
  };
  const absl::Status status = lumifold::worker::RunWorker(
      lumifold::rpc::MakeChannel(flags.server, lumifold::rpc::Security{}), std::move(options), never);
  if (!status.ok()) {
    std::fprintf(stderr, "lumifold-worker: %s\n", std::string(status.message()).c_str());
    return kExitFailure;
  }
  log->info("event=stop name={}", flags.name);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app(
      "Renders units for a Lumifold coordinator. SIGINT or SIGTERM lets it finish or hand back its units and "
      "leave; "
      "a second one ends it at once.",
      "lumifold-worker");
  Flags flags;
  AddFlags(&app, &flags);
  std::string problem;
  try {
    app.parse(argc, argv);
    if (const std::string error = TagsError(flags.tags); !error.empty()) problem = "--tags: " + error;
  } catch (const CLI::Success& success) {
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    problem = error.what();
  }
  if (problem.empty()) return RunWorkerProcess(flags);
  std::fprintf(stderr, "lumifold-worker: %s\n", problem.c_str());
  return kExitUsage;
}
