#pragma once

#include <string>

#include "proto/logging/fields.h"

namespace lumifold::server {

using logging::Quoted;

/// The name of a worker as logs, lists and commands have it: one field of a line.
inline std::string WorkerName(const std::string& name) { return logging::OneWord(name); }

}  // namespace lumifold::server
