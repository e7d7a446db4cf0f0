#pragma once

#include <functional>
#include <memory>
#include <ostream>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/autoscale/engine.h"
#include "client/autoscale/policy/policy.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::autoscale {

struct AutoscalerOptions {
  Limits limits;
  Tuning tuning;
  /// Look and decide, and change nothing.
  bool dry_run = false;
  /// Reads the farm's state.
  std::function<absl::StatusOr<FarmState>()> read_farm = {};
  /// Keeps the history after each step.
  std::function<absl::Status(const History&)> keep = {};
  std::function<absl::Time()> now = {};
  std::shared_ptr<spdlog::logger> log = {};
};

/// Reads farm and engine, decides, and tells the engine.
/// Threads: one at a time.
class Autoscaler {
 public:
  /// `engine` must outlive it.
  Autoscaler(AutoscalerOptions options, History history, Engine* engine);

  /// One step, and its decision. Where farm or engine cannot be read nothing is started or released. A start
  /// that the engine refuses is no error: the next steps wait (see Decide).
  /// Errors: those of farm and engine, with kDeadlineExceeded as kUnavailable; those of keeping the history.
  absl::StatusOr<Decision> Step();

 private:
  void Act(const EngineState& seen, const Decision& decision);
  void Log(const Decision& decision);

  const AutoscalerOptions options_;
  History history_;
  Engine* const engine_;
  std::string last_logged_;
};

/// {"wanted":4,"pending":1,"running":2,"start":1,"release":[{"id":"12","why":"..."}],"reason":"..."}
std::string DecisionJson(const Decision& decision);
/// The reason, then a line for each release.
std::string DecisionText(const Decision& decision);

}  // namespace lumifold::autoscale
