#include "worker/worker_flags.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/device/device_option.h"
#include "proto/monitoring/metrics_flag.h"
#include "proto/rpc/version.h"
#include "worker/render/renderer.h"

namespace lumifold::worker {
namespace {

void AddTimeFlags(CLI::App* app, TimeFlags* flags) {
  app->add_option(
         "--drain-seconds", flags->drain_seconds,
         "After SIGINT or SIGTERM, and at the end of --hours: time to finish the units being rendered")
      ->check(CLI::Range(0.0, 86400.0))
      ->capture_default_str();
  CLI::callback_t read_hours = [flags](const CLI::results_t& texts) {
    const auto hours = WorkingHours::Parse(texts.back());
    if (!hours.ok()) throw CLI::ValidationError("--hours", std::string(hours.status().message()));
    flags->hours = *hours;
    return true;
  };
  app->add_option("--hours", std::move(read_hours),
                  "When it takes units, by local time: 19:00-07:00, or 'Mon-Fri 19:00-07:00,Sat-Sun "
                  "00:00-24:00' (default: "
                  "always)")
      ->type_name("HOURS")
      ->allow_extra_args(false);
  app->add_option(
         "--only-idle", flags->only_idle,
         "Take units only while other programs keep less than this number of cores busy: 0.5 (default: "
         "always)")
      ->check(CLI::Range(0.01, 4096.0));
  app->add_option("--exit-when-idle", flags->exit_when_idle_seconds,
                  "Seconds without a unit after which the worker ends (default: never)")
      ->check(CLI::Range(0.0, 1e9));
}

void AddFinishFlags(CLI::App* app, Flags* flags) {
  app->add_option(
         "--finish", flags->finish,
         "Whether it also assembles and filters frames for which the coordinator has no place: auto, "
         "never, or only, and then it renders nothing")
      ->check(CLI::IsMember({"auto", "never", "only"}))
      ->capture_default_str();
  app->add_option("--device", flags->device.word,
                  "What filters these frames beside the processor, with the same bits: auto (a GPU, if there "
                  "is one), cpu, gpu, or gpu:N, number N of 'lumifold doctor'")
      ->check(device::KnownDevice())
      ->type_name("DEVICE")
      ->capture_default_str();
  app->add_flag("--allow-other-bits", flags->device.allows_other_bits,
                "Allow a GPU that rounds otherwise: frames differ from others' in the last bits, and the "
                "worker's numeric class says so");
}

}  // namespace

std::string DefaultName() {
  char host[256] = "worker";
  gethostname(host, sizeof(host) - 1);
  return absl::StrCat(host, ":", getpid());
}

void AddFlags(CLI::App* app, Flags* flags) {
  app->add_option("--server", flags->server,
                  "The coordinator, or those of one farm: A:7700,B:7700 (default: that of the profile, "
                  "else 127.0.0.1:7700)")
      ->type_name("HOST:PORT,...");
  app->add_option("--profile", flags->profile, "A profile of 'enroll' (default: the coordinator's)")
      ->type_name("NAME");
  app->add_flag("--insecure", flags->insecure, "Allow a coordinator of another machine without encryption");
  app->add_option("--threads", flags->threads,
                  "Number of units rendered at the same time (default: one for each core)")
      ->check(CLI::Range(1, 1024));
  AddFinishFlags(app, flags);
  app->add_option(
         "--nice", flags->niceness,
         "Niceness at least: the worker yields to other programs of its machine, and to a coordinator, "
         "for whom other workers may wait")
      ->check(CLI::Range(0, 19))
      ->capture_default_str();
  app->add_option("--name", flags->name, "Name in the coordinator's log (default: HOST:PID)")
      ->type_name("NAME");
  app->add_option("--tags", flags->tags, "What the machine has or may be used for: gpu,night")
      ->type_name("TAG,...")
      ->delimiter(',');
  AddTimeFlags(app, &flags->times);
  app->add_option("--asset-cache", flags->asset_cache.folder,
                  "Folder of this machine where files of scenes are kept for other workers and later ones")
      ->type_name("DIR");
  app->add_option("--asset-cache-gb", flags->asset_cache.gb,
                  "Size at which the least recently used of them go")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  monitoring::AddMetricsFlag(app, &flags->metrics_address);
  app->add_option("--memory-mb", flags->sandbox.memory_mb,
                  "Limit of the address space in MiB; 0: none (default: the machine's memory and a reserve)");
  app->add_option("--user", flags->sandbox.user,
                  "User to become when started as root; root: stay. With a profile: always its owner")
      ->type_name("USER")
      ->capture_default_str();
  app->add_flag("--no-sandbox", flags->sandbox.off,
                "For debugging: no limits, all files, all system calls, and root stays root");
  logging::AddLogFlags(app, &flags->log);
  app->footer(
      "Example: lumifold-worker --server render-1:7700 --threads 8\n"
      "Exit codes: 0 it has left, 1 failed, 2 wrong command line, 3 the coordinator does not admit it:\n"
      "its certificate was revoked, has expired or is not known, 4 it reached no coordinator within\n"
      "--exit-when-idle, 130 it was told to leave and then got SIGINT.");
  app->set_version_flag("--version",
                        absl::StrCat("lumifold-worker ", std::string(rpc::kVersion), " (numeric class ",
                                     render::NumericClass(), ")"),
                        "Print the version and exit");
}

}  // namespace lumifold::worker
