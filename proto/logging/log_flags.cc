#include "proto/logging/log_flags.h"

#include <CLI/CLI.hpp>

namespace lumifold::logging {

void AddLogFlags(CLI::App* app, LogOptions* options) {
  app->add_option("--log-level", options->level, "Minimum level of the log on standard error")
      ->check(CLI::IsMember({"debug", "info", "warn", "error", "off"}))
      ->capture_default_str();
  app->add_option("--log-format", options->format, "text, or json: one object a line")
      ->check(CLI::IsMember({"text", "json"}))
      ->capture_default_str();
}

}  // namespace lumifold::logging
