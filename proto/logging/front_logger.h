#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string_view>

#include "proto/logging/event_limit.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::logging {

class JobLabels;
struct Line;

/// A line on its way, valid during the call.
struct PassedLine {
  std::chrono::system_clock::time_point time;
  std::string_view level;  // LevelName
  std::string_view text;
  const Line& parsed;
};

struct FrontOptions {
  /// Where lines go on to, at its level.
  std::shared_ptr<spdlog::logger> log;
  EventLimits limits = {};
  /// Added to lines about jobs, together with the field `job` where only `unit` names it; and the worker.
  /// Null: nothing.
  std::shared_ptr<JobLabels> labels = nullptr;
  /// Called with each line that goes on, and with those at info and above whatever the level of `log`. One at
  /// a time; it must not log. Null: nothing.
  std::function<void(const PassedLine&)> keep = nullptr;
};

/// The logger that a program writes to: drops lines of an event that comes too often, and says how many in a
/// line "event=lines_dropped of=EVENT count=N" before the first line of a later second, or at its end.
/// Threads: safe.
std::shared_ptr<spdlog::logger> MakeFrontLogger(FrontOptions options);

}  // namespace lumifold::logging
