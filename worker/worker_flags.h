#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "filter/opencl/open_device.h"
#include "proto/logging/log_flags.h"
#include "proto/sandbox/sandbox.h"
#include "worker/availability/availability.h"

namespace CLI {
class App;
}

namespace lumifold::worker {

/// Host and process.
std::string DefaultName();

struct SandboxFlags {
  std::string user = sandbox::DefaultUser();
  std::optional<uint64_t> memory_mb;  // default: by the machine
  bool off = false;
};

/// The folder of this machine where assets are kept.
struct AssetCacheFlags {
  std::string folder;
  uint64_t gb = 20;
};

/// When the worker renders, and how it ends.
struct TimeFlags {
  std::optional<WorkingHours> hours;
  std::optional<double> only_idle;
  double drain_seconds = 30;
  double exit_when_idle_seconds = std::numeric_limits<double>::infinity();
};

/// The options of lumifold-worker.
struct Flags {
  std::string server;
  std::string profile;
  bool insecure = false;
  std::string code;  // of enroll
  std::string name = DefaultName();
  logging::LogOptions log = {.name = "worker"};
  int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  std::string finish = "auto";
  filter::DeviceChoice device;
  int niceness = 10;
  std::vector<std::string> tags;
  TimeFlags times;
  SandboxFlags sandbox;
  AssetCacheFlags asset_cache;
  std::string metrics_address;
};

/// Adds the options, and what the help says besides.
void AddFlags(CLI::App* app, Flags* flags);

}  // namespace lumifold::worker
