#pragma once

#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/str_replace.h"
#include "proto/logging/fields.h"

namespace lumifold::server {

using logging::Quoted;

/// The name of a worker as logs, lists and commands have it: escaped, and one word, so that it is one field of a line.
inline std::string WorkerName(const std::string& name) {
  return absl::StrReplaceAll(absl::Utf8SafeCEscape(name), {{" ", "\\x20"}});
}

}  // namespace lumifold::server
