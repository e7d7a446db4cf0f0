#pragma once

#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"

namespace lumifold::server {

/// Escapes text of clients and workers for one line of the log.
inline std::string Quoted(const std::string& text) {
  return absl::StrCat("\"", absl::Utf8SafeCEscape(rpc::BoundedLine(text, rpc::kMaxErrorBytes)), "\"");
}

/// The name of a worker as logs, lists and commands have it: escaped, and one word, so that it is one field of a line.
inline std::string WorkerName(const std::string& name) {
  return absl::StrReplaceAll(absl::Utf8SafeCEscape(name), {{" ", "\\x20"}});
}

}  // namespace lumifold::server
