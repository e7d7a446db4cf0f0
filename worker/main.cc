#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/nonblocking_log.h"
#include "proto/rpc/version.h"
#include "spdlog/spdlog.h"
#include "worker/connection.h"
#include "worker/render/renderer.h"

namespace {

constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;

std::string DefaultName() {
  char host[256] = "worker";
  gethostname(host, sizeof(host) - 1);
  return absl::StrCat(host, ":", getpid());
}

/// Notifies `stop` on the first SIGINT or SIGTERM. The signals are blocked in all threads and received by
/// sigwait, so that no code runs in a signal handler.
std::thread WatchSignals(lumifold::rpc::MonotonicEvent* stop) {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  signal(SIGPIPE, SIG_IGN);  // a log without a reader must not end the worker
  return std::thread([set, stop] {
    int received = 0;
    sigwait(&set, &received);
    stop->Notify();
  });
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Renders units for a Lumifold coordinator until SIGINT or SIGTERM.", "lumifold-worker");
  std::string server = "127.0.0.1:7700";
  std::string name = DefaultName();
  std::string log_level = "info";
  int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  lumifold::rpc::Security security;
  app.add_option("--server", server, "Coordinator, HOST:PORT")->capture_default_str();
  app.add_option("--threads", threads, "Number of units rendered at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--name", name, "Name in the coordinator's log")->capture_default_str();
  app.add_option("--log-level", log_level, "Minimum level of the log on standard error")
      ->check(CLI::IsMember({"debug", "info", "warn", "error", "off"}))
      ->capture_default_str();
  app.set_version_flag("--version", absl::StrCat("lumifold-worker ", std::string(lumifold::rpc::kVersion),
                                                 " (numeric class ", lumifold::render::NumericClass(), ")"));
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& success) {
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "lumifold-worker: %s\n", error.what());
    return kExitUsage;
  }

  const std::shared_ptr<spdlog::logger> log =
      lumifold::rpc::MakeNonblockingLogger({.name = "worker", .level = log_level});
  lumifold::rpc::MonotonicEvent stop;
  WatchSignals(&stop).detach();
  log->info("event=start name={} server={} threads={} class={}", name, server, threads,
            lumifold::render::NumericClass());
  lumifold::worker::WorkerOptions options{.name = name, .threads = threads, .log = log};
  const absl::Status status =
      lumifold::worker::RunWorker(lumifold::rpc::MakeChannel(server, security), std::move(options), stop);
  if (!status.ok()) {
    std::fprintf(stderr, "lumifold-worker: %s\n", std::string(status.message()).c_str());
    return kExitFailure;
  }
  log->info("event=stop name={}", name);
  return 0;
}
