#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace lumifold::charts {

/// The origin of a page; WritePage() adds date, commit and machine.
struct Provenance {
  std::string command;
  int threads = 1;
};

/// Writes a page of Markdown: title, origin and `body`. Errors: kUnavailable naming the file.
absl::Status WritePage(const std::string& path, const std::string& title, const Provenance& provenance,
                       const std::string& body);

/// "| a | b |\n".
std::string TableLine(const std::vector<std::string>& cells);
/// The header line and the line of dashes below it.
std::string TableHead(const std::vector<std::string>& names);
/// "0.123", or "not run" without a value.
std::string ErrorCell(std::optional<double> error);
/// "0.123", or "-" without a value.
std::string ScoreCell(std::optional<double> score);
/// Six digits, or nothing without a value: a cell of a CSV.
std::string CsvCell(std::optional<double> value);

}  // namespace lumifold::charts
