#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "absl/time/time.h"
#include "worker/availability/others_load.h"
#include "worker/availability/working_hours.h"

namespace lumifold::worker {

struct AvailabilityOptions {
  /// nullopt: at all hours.
  std::optional<WorkingHours> hours = std::nullopt;
  absl::TimeZone zone = absl::UTCTimeZone();
  std::function<absl::Time()> wall_now = nullptr;
  /// Cores that others may keep busy; nullopt: all of them.
  std::optional<double> max_load = std::nullopt;
  /// Processor times, where there is a limit; nullopt where they cannot be read.
  std::function<std::optional<CpuTimes>()> cpu = nullptr;
  std::function<absl::Time()> now = nullptr;
};

/// Whether a worker may render now.
/// Threads: thread-compatible.
class Availability {
 public:
  explicit Availability(AvailabilityOptions options);

  /// Why the worker rests: "off hours until 19:00", "others use this machine, limit 1 cores"; empty if it may
  /// render. A few system calls.
  std::string RestReason();

 private:
  std::string HoursReason() const;
  std::string LoadReason();

  const AvailabilityOptions options_;
  std::optional<OthersLoad> load_;
  absl::Time next_look_ = absl::InfinitePast();
};

}  // namespace lumifold::worker
