#pragma once

#include "proto/logging/nonblocking_log.h"

namespace CLI {
class App;
}  // namespace CLI

namespace lumifold::logging {

/// Adds --log-level and --log-format, which set `options`, to a program that logs. `options` must outlive
/// `app`.
void AddLogFlags(CLI::App* app, LogOptions* options);

}  // namespace lumifold::logging
