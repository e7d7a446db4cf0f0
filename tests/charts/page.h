#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace lumifold::charts {

/// What made a page: the command, and where, when and from which commit it ran.
struct Provenance {
  std::string command;
  int threads = 1;
};

/// Writes a page of Markdown under a heading and the words that say what made it.
/// Errors: kUnavailable naming the file.
absl::Status WritePage(const std::string& path, const std::string& title, const Provenance& provenance,
                       const std::string& body);

/// "| a | b |\n".
std::string TableLine(const std::vector<std::string>& cells);
/// The line of names and the one of dashes below it.
std::string TableHead(const std::vector<std::string>& names);
/// "0.123", or "not run" for what was not.
std::string ErrorCell(std::optional<double> error);

}  // namespace lumifold::charts
